#include "server/ws/channel.h"

#include <errno.h>
#include <glib.h>
#include <string.h>
#include <wslay/wslay.h>

/* Bytes read per turn, so that one busy peer does not block the others. */
#define READ_BUDGET 4096
/* wslay allocates some hundred bytes per fragment, so a message in one-byte fragments would take megabytes. */
#define MOST_FRAGMENTS 1024

/* wslay copies messages, so a message with a large shared body is framed here, between wslay's messages. */
typedef struct shared_message {
  GBytes *body;           /* NULL: none pending */
  uint8_t *head;          /* [head_size], g_malloc'ed: frame header, then message head */
  size_t head_size, sent; /* sent: bytes of head and body sent so far */
  bool behind;            /* wslay had queued messages before this one: they go first */
} shared_message;

struct tcs_channel {
  wslay_event_context_ptr wslay;
  tcs_channel_callbacks callbacks;
  void *user;
  size_t budget;
  shared_message shared;
  bool closing, broken; /* broken: the pipe failed */
  unsigned fragments;   /* of the message being received */
  bool in_close;
  uint8_t close_body[125];
  size_t close_size;
};

static ssize_t on_receive(wslay_event_context_ptr wslay, uint8_t *bytes, size_t size, int flags, void *user) {
  tcs_channel *channel = user;
  if (channel->budget == 0 || tcs_channel_queued(channel) > TCS_MAX_QUEUED) {
    wslay_event_set_error(wslay, WSLAY_ERR_WOULDBLOCK);
    return -1;
  }
  const ssize_t got = channel->callbacks.receive(channel->user, bytes, MIN(size, channel->budget));
  if (got > 0) {
    channel->budget -= (size_t)got;
    return got;
  }
  const bool later = got < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR);
  channel->broken = !later;
  wslay_event_set_error(wslay, later ? WSLAY_ERR_WOULDBLOCK : WSLAY_ERR_CALLBACK_FAILURE);
  return -1;
}

/* Returns bytes sent, 0 = would block, -1 = broken. */
static ssize_t give(tcs_channel *channel, const uint8_t *bytes, size_t size, bool more) {
  const ssize_t sent = channel->callbacks.send(channel->user, bytes, size, more);
  if (sent >= 0) return sent;
  return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR ? 0 : -1;
}

static ssize_t on_send(wslay_event_context_ptr wslay, const uint8_t *bytes, size_t size, int flags, void *user) {
  tcs_channel *channel = user;
  const ssize_t sent = give(channel, bytes, size, (flags & WSLAY_MSG_MORE) != 0);
  if (sent > 0) return sent;
  wslay_event_set_error(wslay, sent == 0 ? WSLAY_ERR_WOULDBLOCK : WSLAY_ERR_CALLBACK_FAILURE);
  return -1;
}

static void on_message(wslay_event_context_ptr wslay, const struct wslay_event_on_msg_recv_arg *message, void *user) {
  tcs_channel *channel = user;
  switch (message->opcode) {
  case WSLAY_TEXT_FRAME:
    if (channel->closing) break;
    /* An empty message has no buffer. */
    channel->callbacks.text(channel->user, message->msg ? (const char *)message->msg : "", message->msg_length);
    break;
  case WSLAY_BINARY_FRAME: tcs_channel_close(channel, WSLAY_CODE_UNSUPPORTED_DATA, "messages are text"); break;
  case WSLAY_CONNECTION_CLOSE: channel->closing = true; break;
  default: break; /* wslay answers pings; a pong only shows that the peer is alive */
  }
}

/* --- close frames: checks that wslay omits (RFC 6455, section 5.5.1): a body of one byte, and UTF-8 of a reason that
 * arrives in pieces */

static void on_frame_start(wslay_event_context_ptr wslay, const struct wslay_event_on_frame_recv_start_arg *frame,
                           void *user) {
  tcs_channel *channel = user;
  channel->in_close = frame->opcode == WSLAY_CONNECTION_CLOSE;
  if (frame->opcode != WSLAY_CONTINUATION_FRAME) {
    if (!wslay_is_ctrl_frame(frame->opcode)) channel->fragments = 1;
  } else if (++channel->fragments > MOST_FRAGMENTS) {
    tcs_channel_close(channel, WSLAY_CODE_MESSAGE_TOO_BIG, "too many fragments");
    wslay_event_shutdown_read(wslay);
  }
}

static void on_frame_chunk(wslay_event_context_ptr wslay, const struct wslay_event_on_frame_recv_chunk_arg *chunk,
                           void *user) {
  tcs_channel *channel = user;
  if (!channel->in_close || chunk->data_length > sizeof channel->close_body - channel->close_size) return;
  memcpy(channel->close_body + channel->close_size, chunk->data, chunk->data_length);
  channel->close_size += chunk->data_length;
}

static void on_frame_end(wslay_event_context_ptr wslay, void *user) {
  tcs_channel *channel = user;
  const size_t size = channel->close_size;
  if (!channel->in_close) return;
  if (size == 1) tcs_channel_close(channel, WSLAY_CODE_PROTOCOL_ERROR, "a close code has two bytes");
  if (size > 2 && !g_utf8_validate((const char *)channel->close_body + 2, (gssize)size - 2, NULL))
    tcs_channel_close(channel, WSLAY_CODE_INVALID_FRAME_PAYLOAD_DATA, "");
}

tcs_channel *tcs_channel_new(const tcs_channel_callbacks *callbacks, void *user) {
  static const struct wslay_event_callbacks events = {.recv_callback = on_receive,
                                                      .send_callback = on_send,
                                                      .on_frame_recv_start_callback = on_frame_start,
                                                      .on_frame_recv_chunk_callback = on_frame_chunk,
                                                      .on_frame_recv_end_callback = on_frame_end,
                                                      .on_msg_recv_callback = on_message};
  tcs_channel *channel = g_new0(tcs_channel, 1);
  channel->callbacks = *callbacks;
  channel->user = user;
  if (wslay_event_context_server_init(&channel->wslay, &events, channel) != 0) {
    g_free(channel);
    return NULL;
  }
  /* wslay's default would let one 14-byte header allocate 2 GiB. */
  wslay_event_config_set_max_recv_msg_length(channel->wslay, TCS_MAX_MESSAGE);
  return channel;
}

static void drop_shared(shared_message *message) {
  if (message->body) g_bytes_unref(message->body);
  g_free(message->head);
  *message = (shared_message){0};
}

void tcs_channel_free(tcs_channel *channel) {
  if (!channel) return;
  drop_shared(&channel->shared);
  wslay_event_context_free(channel->wslay);
  g_free(channel);
}

bool tcs_channel_read(tcs_channel *channel) {
  channel->budget = READ_BUDGET;
  if (wslay_event_recv(channel->wslay) == 0) return true;
  /* Malformed frame: wslay queues an empty close frame. Send one with the reason instead, unless a message is half
   * sent. */
  static const uint8_t protocol_error[] = {0x88, 2, WSLAY_CODE_PROTOCOL_ERROR >> 8, WSLAY_CODE_PROTOCOL_ERROR & 255};
  if (!channel->broken && tcs_channel_queued(channel) <= 1)
    channel->callbacks.send(channel->user, protocol_error, sizeof protocol_error, false);
  return false;
}

/* False: the pipe is broken. True with the body still pending: the pipe is full. */
static bool send_shared(tcs_channel *channel) {
  shared_message *m = &channel->shared;
  gsize body_size;
  const uint8_t *body = g_bytes_get_data(m->body, &body_size);
  while (m->sent < m->head_size + body_size) {
    const bool in_head = m->sent < m->head_size;
    const uint8_t *from = in_head ? m->head + m->sent : body + (m->sent - m->head_size);
    const size_t left = in_head ? m->head_size - m->sent : m->head_size + body_size - m->sent;
    const ssize_t sent = give(channel, from, left, in_head && body_size > 0);
    if (sent <= 0) return sent == 0;
    m->sent += (size_t)sent;
  }
  drop_shared(m);
  return true;
}

bool tcs_channel_write(tcs_channel *channel) {
  const shared_message *m = &channel->shared;
  if (m->body && m->behind && wslay_event_send(channel->wslay) != 0) return false;
  if (m->body && (!m->behind || wslay_event_get_queued_msg_count(channel->wslay) == 0)) {
    channel->shared.behind = false;
    if (!send_shared(channel)) return false;
  }
  return m->body || wslay_event_send(channel->wslay) == 0;
}

static bool queue(tcs_channel *channel, uint8_t opcode, const void *bytes, size_t size) {
  const struct wslay_event_msg message = {.opcode = opcode, .msg = bytes, .msg_length = size};
  return !channel->closing && wslay_event_queue_msg(channel->wslay, &message) == 0;
}

bool tcs_channel_send_text(tcs_channel *channel, const char *text) {
  return queue(channel, WSLAY_TEXT_FRAME, text, strlen(text));
}

/* Writes an unmasked frame header with FIN (RFC 6455, section 5.2). Returns its size. */
static size_t frame_head(uint8_t head[10], uint8_t opcode, uint64_t size) {
  const int wide = size < 126 ? 0 : size < 65536 ? 2 : 8;
  head[0] = 0x80 | opcode;
  head[1] = wide == 0 ? (uint8_t)size : wide == 2 ? 126 : 127;
  for (int i = 0; i < wide; i++) head[2 + i] = (uint8_t)(size >> (8 * (wide - 1 - i)));
  return 2 + (size_t)wide;
}

bool tcs_channel_send_shared(tcs_channel *channel, bool binary, const void *head, size_t head_size, GBytes *body) {
  shared_message *m = &channel->shared;
  if (channel->closing || m->body) return false;
  uint8_t frame[10];
  const size_t frame_size =
      frame_head(frame, binary ? WSLAY_BINARY_FRAME : WSLAY_TEXT_FRAME, head_size + g_bytes_get_size(body));
  m->head = g_malloc(frame_size + head_size);
  memcpy(m->head, frame, frame_size);
  if (head_size) memcpy(m->head + frame_size, head, head_size);
  m->head_size = frame_size + head_size;
  m->body = g_bytes_ref(body);
  m->behind = wslay_event_get_queued_msg_count(channel->wslay) > 0;
  return true;
}

bool tcs_channel_ping(tcs_channel *channel) { return queue(channel, WSLAY_PING, NULL, 0); }

void tcs_channel_close(tcs_channel *channel, uint16_t code, const char *reason) {
  if (channel->closing) return;
  wslay_event_queue_close(channel->wslay, code, (const uint8_t *)reason, strlen(reason));
  channel->closing = true;
}

bool tcs_channel_wants_read(tcs_channel *channel) {
  return wslay_event_want_read(channel->wslay) && tcs_channel_queued(channel) <= TCS_MAX_QUEUED;
}

bool tcs_channel_wants_write(tcs_channel *channel) {
  return channel->shared.body || wslay_event_want_write(channel->wslay);
}

size_t tcs_channel_queued(tcs_channel *channel) {
  return wslay_event_get_queued_msg_count(channel->wslay) + (channel->shared.body != NULL);
}

bool tcs_channel_closing(tcs_channel *channel) {
  return channel->closing || wslay_event_get_close_received(channel->wslay) ||
         wslay_event_get_close_sent(channel->wslay);
}

bool tcs_channel_done(tcs_channel *channel) {
  return !wslay_event_want_read(channel->wslay) && !tcs_channel_wants_write(channel);
}
