#include "server/ws/stream.h"

#include <errno.h>
#include <microhttpd.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>

#include "server/access/access.h"
#include "server/config/config.h"
#include "server/loop/loop.h"
#include "server/loop/worker.h"
#include "server/observe/metrics.h"
#include "server/session/deliver.h"
#include "server/session/scope.h"
#include "server/session/session_scene.h"
#include "server/session/sessions.h"
#include "server/session/viewers.h"
#include "server/ws/allowance.h"
#include "server/ws/channel.h"
#include "server/ws/handshake.h"

#define PING_US 15000000    /* interval of pings */
#define SILENCE_US 30000000 /* a peer silent for this long is disconnected */
#define PIECE ((size_t)128) /* bytes per read: a few short messages */
#define CLOSE_US 2000000    /* time limit of a closing handshake */

typedef struct tcs_stream {
  tcs_source source; /* must be first: the loop passes the source */
  tcs_watcher watcher;
  tcs_streams *streams;
  struct MHD_UpgradeResponseHandle *handle;
  tcs_caller caller;
  tcs_channel *channel;
  GByteArray *extra; /* received with the handshake; consumed before the socket is read */
  uint32_t events;
  int64_t read_us; /* when this turn began to read */
  int64_t heard_us, pinged_us, sent_us, closing_us;
  tcs_allowance share;
  int64_t resume_us;   /* reading pauses until then; 0 = not paused */
  struct hello *hello; /* being written by the worker; no reading until it is sent */
  bool dead, inside;   /* inside: called from the channel, so that nothing may be torn down */
} tcs_stream;

struct tcs_streams {
  tcs_server *server;
  GPtrArray *live, *dead;
};

static void settle(tcs_stream *stream);

static tcs_stream *of_watcher(const tcs_watcher *watcher) {
  return (tcs_stream *)(void *)((char *)(uintptr_t)watcher - offsetof(tcs_stream, watcher));
}

/* --- bytes ---------------------------------------------------------------------------------------- */

static ssize_t on_receive(void *user, uint8_t *bytes, size_t size) {
  tcs_stream *stream = user;
  if (stream->extra->len) {
    const guint count = (guint)MIN(size, stream->extra->len);
    memcpy(bytes, stream->extra->data, count);
    g_byte_array_remove_range(stream->extra, 0, count);
    return count;
  }
  /* Messages are handled as they are read, and refusing some patches takes milliseconds. So the time is checked every
   * few messages, and the rest is read in the loop's next turn. */
  if (g_get_monotonic_time() - stream->read_us > TCS_TURN_US) {
    errno = EAGAIN;
    return -1;
  }
  const ssize_t got = recv(stream->source.fd, bytes, MIN(size, PIECE), MSG_DONTWAIT);
  if (got > 0) stream->heard_us = g_get_monotonic_time();
  return got;
}

static ssize_t on_send(void *user, const uint8_t *bytes, size_t size, bool more) {
  tcs_stream *stream = user;
  const ssize_t sent = send(stream->source.fd, bytes, size, MSG_DONTWAIT | MSG_NOSIGNAL | (more ? MSG_MORE : 0));
  if (sent > 0) stream->sent_us = g_get_monotonic_time();
  return sent;
}

/* --- messages ------------------------------------------------------------------------------------- */

static void send_json(tcs_stream *stream, cJSON *json) {
  char *text = cJSON_PrintUnformatted(json);
  if (text) tcs_channel_send_text(stream->channel, text);
  cJSON_free(text);
  cJSON_Delete(json);
}

static void send_error(tcs_stream *stream, uint64_t seq, cJSON *problem) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "type", "error");
  cJSON_AddNumberToObject(json, "seq", (double)seq);
  cJSON_AddItemToObject(json, "problem", problem);
  send_json(stream, json);
  stream->streams->server->metrics->ws_errors++;
}

static void send_pong(tcs_stream *stream, double t) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "type", "pong");
  cJSON_AddNumberToObject(json, "t", t);
  send_json(stream, json);
}

static bool take_patch(tcs_stream *stream, const tcp_message *message, GError **error) {
  const char *forbidden = tcs_patch_forbidden(&stream->caller, stream->watcher.session, message->scene);
  if (!forbidden) return tcs_watcher_patch(&stream->watcher, message->seq, message->scene, error);
  send_error(stream, message->seq, tcp_problem_named(403, "forbidden", "Not allowed", forbidden));
  return true;
}

static void on_text(void *user, const char *bytes, size_t size) {
  tcs_stream *stream = user;
  tcs_watcher *watcher = &stream->watcher;
  GError *error = NULL;
  tcp_message message = {0};
  stream->streams->server->metrics->ws_messages++;
  if (!watcher->session) return;
  bool ok = tcp_message_parse(bytes, size, &message, &error);
  if (ok) {
    switch (message.type) {
    case TCP_PATCH: ok = take_patch(stream, &message, &error); break;
    case TCP_ACK: ok = tcs_watcher_ack(watcher, message.frame, &error); break;
    case TCP_POINTER:
      if (stream->caller.role >= TCS_ROLE_EDIT) tcs_watcher_pointer(watcher, message.pointer_down);
      break;
    case TCP_CANCEL:
      if (stream->caller.role >= TCS_ROLE_EDIT) tcs_session_give_up(watcher->session);
      break;
    case TCP_PING: send_pong(stream, message.t); break;
    case TCP_SIZE: ok = tcs_watcher_size(watcher, message.width, message.height, &error); break;
    case TCP_MESSAGE_TYPE_COUNT: break;
    }
  }
  if (!ok) send_error(stream, message.seq, tcp_problem(error));
  g_clear_error(&error);
  tcp_message_clear(&message);
}

/* The first message, with the whole scene. With many knots this is megabytes, so a worker writes the text. Nothing is
 * read or sent before it. */
struct hello {
  tcs_task task;
  tcs_stream *stream; /* NULL: the stream died meanwhile */
  char session[40];   /* the id, since the session may end meanwhile */
  tc_scene scene;
  cJSON *json;
  char *text;
};

static void read_some(tcs_stream *stream);

static void run_hello(tcs_task *task) {
  struct hello *hello = (struct hello *)task;
  cJSON_AddItemToObject(hello->json, "scene", tcp_scene_write(&hello->scene));
  hello->text = cJSON_PrintUnformatted(hello->json);
  cJSON_Delete(g_steal_pointer(&hello->json));
}

static void greet(tcs_stream *stream, struct hello *hello) {
  const tcs_server *server = stream->streams->server;
  tcs_session *session = tcs_sessions_find(server->sessions, hello->session);
  GBytes *text = g_bytes_new_take(hello->text, hello->text ? strlen(hello->text) : 0);
  hello->text = NULL;
  stream->hello = NULL;
  tcs_channel_send_shared(stream->channel, false, NULL, 0, text);
  g_bytes_unref(text);
  if (!session) tcs_channel_close(stream->channel, 1001, "the session has ended");
  settle(stream);
  if (stream->dead || tcs_channel_closing(stream->channel)) return;
  tcs_session_join(session, &stream->watcher, (unsigned)server->config->limits.window);
  if (!stream->dead && stream->extra->len) read_some(stream);
}

static void done_hello(tcs_task *task) {
  struct hello *hello = (struct hello *)task;
  if (hello->stream) greet(hello->stream, hello);
  tc_scene_clear(&hello->scene);
  cJSON_free(hello->text);
  g_free(hello);
}

static void send_hello(tcs_stream *stream, tcs_session *session) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "type", "hello");
  cJSON_AddStringToObject(json, "protocol", TCS_SUBPROTOCOL);
  cJSON_AddStringToObject(json, "session", session->id);
  cJSON_AddStringToObject(json, "volume", session->entry->id);
  cJSON_AddNumberToObject(json, "window", stream->watcher.credit.limit);
  cJSON_AddStringToObject(json, "role", tcs_role_name(stream->caller.role));
  cJSON_AddStringToObject(json, "server", "tomocast " TC_VERSION);
  struct hello *hello = g_new0(struct hello, 1);
  *hello = (struct hello){.task = {.run = run_hello, .done = done_hello}, .stream = stream, .json = json};
  g_strlcpy(hello->session, session->id, sizeof hello->session);
  tc_scene_copy(&hello->scene, &session->scene);
  stream->hello = hello;
  if (tcs_scene_is_long(&session->scene)) {
    tcs_worker_submit(stream->streams->server->text_worker, &hello->task);
    return;
  }
  run_hello(&hello->task);
  done_hello(&hello->task);
}

/* --- transport of the watcher ---------------------------------------------------------------------- */

static bool on_ready(const tcs_watcher *watcher) {
  const tcs_stream *stream = of_watcher(watcher);
  return !stream->dead && !tcs_channel_closing(stream->channel) && tcs_channel_queued(stream->channel) == 0;
}

static void on_frame(tcs_watcher *watcher, const tcs_picture *picture, const tcp_frame_header *header) {
  tcs_stream *stream = of_watcher(watcher);
  size_t head_size;
  uint8_t *head = tcp_frame_header_write(header, &head_size);
  if (tcs_channel_send_shared(stream->channel, true, head, head_size, picture->image))
    stream->streams->server->metrics->ws_sent_bytes += head_size + g_bytes_get_size(picture->image);
  g_free(head);
  settle(stream);
}

static void on_watcher_text(tcs_watcher *watcher, const char *json) {
  tcs_stream *stream = of_watcher(watcher);
  if (stream->dead || tcs_channel_queued(stream->channel) > TCS_MAX_QUEUED) return;
  tcs_channel_send_text(stream->channel, json);
  settle(stream);
}

static void on_end(tcs_watcher *watcher) {
  tcs_stream *stream = of_watcher(watcher);
  if (stream->dead) return;
  tcs_channel_close(stream->channel, 1001, "the session has ended");
  settle(stream);
}

static const tcs_watcher_ops stream_ops = {on_ready, on_frame, on_watcher_text, on_end, true};

/* --- life cycle ------------------------------------------------------------------------------------ */

static void die(tcs_stream *stream) {
  if (stream->dead) return;
  stream->dead = true;
  if (stream->hello) stream->hello->stream = NULL;
  tcs_session_leave(&stream->watcher);
  tcs_server *server = stream->streams->server;
  server->ws_clients--;
  /* Before the descriptor is closed, since its number may be reused at once. */
  tcs_loop_remove(server->loop, &stream->source);
  server->http_work = true;
  MHD_upgrade_action(stream->handle, MHD_UPGRADE_ACTION_CLOSE);
  g_ptr_array_remove_fast(stream->streams->live, stream);
  g_ptr_array_add(stream->streams->dead, stream);
}

/* Sends what the socket takes, closes if finished, and registers the events needed next. */
static void settle(tcs_stream *stream) {
  if (stream->dead || stream->inside) return;
  stream->inside = true;
  const bool had = tcs_channel_queued(stream->channel) > 0;
  bool alive = tcs_channel_write(stream->channel);
  stream->inside = false;
  if (alive && tcs_channel_closing(stream->channel)) {
    tcs_session_leave(&stream->watcher);
    if (!stream->closing_us) stream->closing_us = g_get_monotonic_time();
    alive = !tcs_channel_done(stream->channel);
  }
  if (!alive) {
    die(stream);
    return;
  }
  uint32_t events = 0;
  if (!stream->hello && !stream->resume_us && tcs_channel_wants_read(stream->channel)) events |= EPOLLIN;
  if (tcs_channel_wants_write(stream->channel)) events |= EPOLLOUT;
  if (events != stream->events) tcs_loop_change(stream->streams->server->loop, &stream->source, events);
  stream->events = events;
  /* The send queue is empty: a frame may be waiting for this. */
  if (had && tcs_channel_queued(stream->channel) == 0 && stream->watcher.session) tcs_watcher_pump(&stream->watcher);
}

static void read_some(tcs_stream *stream) {
  const int64_t cpu_us = tcs_thread_cpu_us();
  stream->read_us = g_get_monotonic_time();
  stream->inside = true;
  const bool alive = tcs_channel_read(stream->channel);
  stream->inside = false;
  stream->resume_us = tcs_allowance_spend(&stream->share, stream->read_us, tcs_thread_cpu_us() - cpu_us);
  if (alive)
    settle(stream);
  else
    die(stream);
}

static void on_socket(tcs_source *source, uint32_t events) {
  tcs_stream *stream = (tcs_stream *)source;
  if (events & (EPOLLHUP | EPOLLERR)) {
    die(stream);
    return;
  }
  if (events & EPOLLIN)
    read_some(stream);
  else
    settle(stream);
}

tcs_streams *tcs_streams_new(tcs_server *server) {
  tcs_streams *streams = g_new0(tcs_streams, 1);
  streams->server = server;
  streams->live = g_ptr_array_new();
  streams->dead = g_ptr_array_new();
  return streams;
}

void tcs_streams_free(tcs_streams *streams) {
  if (!streams) return;
  tcs_streams_sweep(streams);
  g_ptr_array_unref(streams->live);
  g_ptr_array_unref(streams->dead);
  g_free(streams);
}

static void set_socket_options(int fd) {
  const int one = 1, low_water = 16384;
  /* MHD re-enables Nagle at hand-over. The low-water mark keeps the backlog in this process, where newer frames replace
   * older ones, instead of in the kernel. */
  setsockopt(fd, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
  setsockopt(fd, IPPROTO_TCP, TCP_NOTSENT_LOWAT, &low_water, sizeof low_water);
}

void tcs_streams_open(tcs_streams *streams, tcs_session *session, const tcs_caller *caller, int fd,
                      struct MHD_UpgradeResponseHandle *handle, const GByteArray *held) {
  static const tcs_channel_callbacks callbacks = {on_receive, on_send, on_text};
  tcs_stream *stream = g_new0(tcs_stream, 1);
  tcs_server *server = streams->server;
  stream->source = (tcs_source){on_socket, fd};
  stream->streams = streams;
  stream->handle = handle;
  stream->caller = *caller;
  stream->watcher.ops = &stream_ops;
  stream->extra = g_byte_array_new();
  g_byte_array_append(stream->extra, held->data, held->len);
  stream->heard_us = stream->pinged_us = stream->sent_us = g_get_monotonic_time();
  tcs_allowance_init(&stream->share, stream->heard_us);
  stream->events = EPOLLIN;
  stream->channel = tcs_channel_new(&callbacks, stream);
  set_socket_options(fd);
  server->ws_clients++;
  server->metrics->ws_connections++;
  g_ptr_array_add(streams->live, stream);
  if (!session || !stream->channel || !tcs_loop_add(server->loop, &stream->source, EPOLLIN, NULL)) {
    die(stream);
    return;
  }
  stream->watcher.credit.limit = (unsigned)server->config->limits.window;
  send_hello(stream, session);
  if (!stream->dead) settle(stream);
}

int tcs_streams_count(const tcs_streams *streams) { return (int)streams->live->len; }

void tcs_streams_tell(tcs_streams *streams, const char *json) {
  for (guint i = streams->live->len; i-- > 0;) {
    tcs_stream *stream = g_ptr_array_index(streams->live, i);
    if (!stream->caller.session[0]) on_watcher_text(&stream->watcher, json); /* names volumes, not for links */
  }
}

int64_t tcs_streams_resume(tcs_streams *streams, int64_t now_us) {
  int64_t next_us = -1;
  for (guint i = streams->live->len; i-- > 0;) {
    tcs_stream *stream = g_ptr_array_index(streams->live, i);
    if (!stream->resume_us) continue;
    if (now_us >= stream->resume_us) {
      stream->resume_us = 0;
      settle(stream);
    } else if (next_us < 0 || stream->resume_us - now_us < next_us) {
      next_us = stream->resume_us - now_us;
    }
  }
  return next_us;
}

void tcs_streams_tick(tcs_streams *streams, int64_t now_us) {
  const int64_t blocked_us = streams->server->config->limits.blocked_seconds * 1000000;
  for (guint i = streams->live->len; i-- > 0;) {
    tcs_stream *stream = g_ptr_array_index(streams->live, i);
    const bool silent = now_us - stream->heard_us > SILENCE_US;
    const bool closing_late = stream->closing_us && now_us - stream->closing_us > CLOSE_US;
    const bool blocked = tcs_channel_queued(stream->channel) > 0 && now_us - stream->sent_us > blocked_us;
    if (silent || closing_late || blocked) {
      die(stream);
    } else if (!stream->closing_us && !tcs_access_lasts(streams->server->access, &stream->caller)) {
      tcs_channel_close(stream->channel, 1008, "the token or link is no longer valid");
      settle(stream);
    } else if (stream->extra->len && !stream->hello) {
      read_some(stream); /* bytes held back while answers were queued; epoll does not report them */
    } else if (now_us - stream->pinged_us > PING_US) {
      stream->pinged_us = now_us;
      tcs_channel_ping(stream->channel);
      settle(stream);
    }
  }
}

void tcs_streams_close_all(tcs_streams *streams, bool at_once) {
  for (guint i = streams->live->len; i-- > 0;) {
    tcs_stream *stream = g_ptr_array_index(streams->live, i);
    if (at_once) {
      die(stream);
    } else {
      tcs_channel_close(stream->channel, 1001, "the server is shutting down");
      settle(stream);
    }
  }
}

void tcs_streams_sweep(tcs_streams *streams) {
  for (guint i = 0; i < streams->dead->len; i++) {
    tcs_stream *stream = g_ptr_array_index(streams->dead, i);
    tcs_channel_free(stream->channel);
    g_byte_array_unref(stream->extra);
    g_free(stream);
  }
  g_ptr_array_set_size(streams->dead, 0);
}
