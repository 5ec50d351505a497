#include "server/ws/channel.h"

#include <errno.h>
#include <glib.h>
#include <string.h>
#include <wslay/wslay.h>

/* Bytes read in one turn, so that one busy peer does not hold up the others. */
#define READ_BUDGET 65536

struct tcs_channel {
  wslay_event_context_ptr wslay;
  tcs_channel_callbacks callbacks;
  void *user;
  size_t budget;
  bool closing, broken; /* broken: the pipe itself failed */
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

static ssize_t on_send(wslay_event_context_ptr wslay, const uint8_t *bytes, size_t size, int flags, void *user) {
  tcs_channel *channel = user;
  const ssize_t sent = channel->callbacks.send(channel->user, bytes, size, (flags & WSLAY_MSG_MORE) != 0);
  if (sent >= 0) return sent;
  const bool later = errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
  wslay_event_set_error(wslay, later ? WSLAY_ERR_WOULDBLOCK : WSLAY_ERR_CALLBACK_FAILURE);
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
  case WSLAY_BINARY_FRAME:
    tcs_channel_close(channel, WSLAY_CODE_UNSUPPORTED_DATA, "messages are text");
    break;
  case WSLAY_CONNECTION_CLOSE:
    channel->closing = true;
    break;
  default:
    break; /* wslay answers pings; a pong is only a sign of life */
  }
}

tcs_channel *tcs_channel_new(const tcs_channel_callbacks *callbacks, void *user) {
  static const struct wslay_event_callbacks events = {
      .recv_callback = on_receive, .send_callback = on_send, .on_msg_recv_callback = on_message};
  tcs_channel *channel = g_new0(tcs_channel, 1);
  channel->callbacks = *callbacks;
  channel->user = user;
  if (wslay_event_context_server_init(&channel->wslay, &events, channel) != 0) {
    g_free(channel);
    return NULL;
  }
  /* wslay's own default lets one 14-byte header ask for 2 GiB. */
  wslay_event_config_set_max_recv_msg_length(channel->wslay, TCS_MAX_MESSAGE);
  return channel;
}

void tcs_channel_free(tcs_channel *channel) {
  if (!channel) return;
  wslay_event_context_free(channel->wslay);
  g_free(channel);
}

bool tcs_channel_read(tcs_channel *channel) {
  channel->budget = READ_BUDGET;
  if (wslay_event_recv(channel->wslay) == 0) return true;
  /* A frame that cannot be one: wslay gives up with an empty close frame in its queue. Say why instead, where nothing
   * is half sent. */
  static const uint8_t protocol_error[] = {0x88, 2, WSLAY_CODE_PROTOCOL_ERROR >> 8, WSLAY_CODE_PROTOCOL_ERROR & 255};
  if (!channel->broken && tcs_channel_queued(channel) <= 1)
    channel->callbacks.send(channel->user, protocol_error, sizeof protocol_error, false);
  return false;
}

bool tcs_channel_write(tcs_channel *channel) { return wslay_event_send(channel->wslay) == 0; }

static bool queue(tcs_channel *channel, uint8_t opcode, const void *bytes, size_t size) {
  const struct wslay_event_msg message = {.opcode = opcode, .msg = bytes, .msg_length = size};
  return !channel->closing && wslay_event_queue_msg(channel->wslay, &message) == 0;
}

bool tcs_channel_send_text(tcs_channel *channel, const char *text) {
  return queue(channel, WSLAY_TEXT_FRAME, text, strlen(text));
}

bool tcs_channel_send_binary(tcs_channel *channel, const void *head, size_t head_size, const void *body,
                             size_t body_size) {
  uint8_t *joined = g_malloc(head_size + body_size);
  memcpy(joined, head, head_size);
  memcpy(joined + head_size, body, body_size);
  const bool ok = queue(channel, WSLAY_BINARY_FRAME, joined, head_size + body_size);
  g_free(joined);
  return ok;
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

bool tcs_channel_wants_write(tcs_channel *channel) { return wslay_event_want_write(channel->wslay); }

size_t tcs_channel_queued(tcs_channel *channel) { return wslay_event_get_queued_msg_count(channel->wslay); }

bool tcs_channel_closing(tcs_channel *channel) {
  return channel->closing || wslay_event_get_close_received(channel->wslay) ||
         wslay_event_get_close_sent(channel->wslay);
}

bool tcs_channel_done(tcs_channel *channel) {
  return !wslay_event_want_read(channel->wslay) && !wslay_event_want_write(channel->wslay);
}
