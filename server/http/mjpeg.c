#include "server/http/mjpeg.h"

#include <netinet/in.h>
#include <netinet/tcp.h>
#include <stddef.h>
#include <string.h>
#include <sys/socket.h>

#include "server/access/audit.h"
#include "server/http/http.h"
#include "server/session/viewers.h"

#define BLOCK 65536

typedef struct tcs_mjpeg {
  tcs_watcher watcher;
  tcs_server *server;
  struct MHD_Connection *connection;
  GList link;
  GBytes *image; /* sent after `head`, before the header of the next part */
  GString *head, *tail;
  size_t sent;        /* of head + image + tail */
  char next_type[16]; /* content type announced for the open part */
  tcs_caller caller;
  bool suspended, ended;
} tcs_mjpeg;

static size_t image_size(const tcs_mjpeg *mjpeg) { return mjpeg->image ? g_bytes_get_size(mjpeg->image) : 0; }

static size_t waiting(const tcs_mjpeg *mjpeg) {
  return mjpeg->head->len + image_size(mjpeg) + mjpeg->tail->len - mjpeg->sent;
}

static void open_part(GString *text, tcs_mjpeg *mjpeg, const char *type) {
  g_string_append_printf(text, "\r\n--tomocast\r\nContent-Type: image/%s\r\n\r\n", type);
  g_strlcpy(mjpeg->next_type, type, sizeof mjpeg->next_type);
}

static void resume(tcs_mjpeg *mjpeg) {
  if (!mjpeg->suspended) return;
  mjpeg->suspended = false;
  mjpeg->server->http_work = true;
  MHD_resume_connection(mjpeg->connection);
}

/* --- transport of the watcher ----------------------------------------------------------------------- */

static tcs_mjpeg *of_watcher(const tcs_watcher *watcher) { return (tcs_mjpeg *)(uintptr_t)watcher; }

static bool on_ready(const tcs_watcher *watcher) {
  const tcs_mjpeg *mjpeg = of_watcher(watcher);
  return !mjpeg->ended && waiting(mjpeg) == 0;
}

static void on_frame(tcs_watcher *watcher, const tcs_picture *picture, const tcp_frame_header *header) {
  tcs_mjpeg *mjpeg = of_watcher(watcher);
  g_string_truncate(mjpeg->head, 0);
  g_string_truncate(mjpeg->tail, 0);
  g_clear_pointer(&mjpeg->image, g_bytes_unref);
  mjpeg->sent = 0;
  if (strcmp(mjpeg->next_type, header->format) != 0) open_part(mjpeg->head, mjpeg, header->format);
  mjpeg->image = g_bytes_ref(picture->image);
  /* A browser shows a part when the next part's header arrives, so this header is sent at once, not with the next
   * picture. */
  open_part(mjpeg->tail, mjpeg, header->format);
  resume(mjpeg);
}

static void on_text(tcs_watcher *watcher, const char *json) {} /* MJPEG has no text messages */

static void on_end(tcs_watcher *watcher) {
  tcs_mjpeg *mjpeg = of_watcher(watcher);
  mjpeg->ended = true;
  resume(mjpeg);
}

static const tcs_watcher_ops mjpeg_ops = {on_ready, on_frame, on_text, on_end, false};

/* --- the response ------------------------------------------------------------------------------------ */

static size_t copy_part(char *to, size_t room, const void *from, size_t size, size_t *skip) {
  if (*skip >= size) {
    *skip -= size;
    return 0;
  }
  const size_t count = MIN(room, size - *skip);
  memcpy(to, (const char *)from + *skip, count);
  *skip = 0;
  return count;
}

static ssize_t read_stream(void *user, uint64_t position, char *bytes, size_t room) {
  tcs_mjpeg *mjpeg = user;
  if (waiting(mjpeg) == 0 && !mjpeg->ended) {
    tcs_credit_ack(&mjpeg->watcher.credit, mjpeg->watcher.credit.sent, g_get_monotonic_time());
    tcs_watcher_pump(&mjpeg->watcher);
  }
  if (mjpeg->ended) return MHD_CONTENT_READER_END_OF_STREAM;
  if (waiting(mjpeg) == 0) {
    mjpeg->suspended = true;
    MHD_suspend_connection(mjpeg->connection);
    return 0;
  }
  size_t skip = mjpeg->sent, done = 0;
  done += copy_part(bytes, room, mjpeg->head->str, mjpeg->head->len, &skip);
  if (mjpeg->image) {
    gsize size;
    const void *image = g_bytes_get_data(mjpeg->image, &size);
    done += copy_part(bytes + done, room - done, image, size, &skip);
  }
  done += copy_part(bytes + done, room - done, mjpeg->tail->str, mjpeg->tail->len, &skip);
  mjpeg->sent += done;
  return (ssize_t)done;
}

static void free_stream(void *user) {
  tcs_mjpeg *mjpeg = user;
  tcs_session_leave(&mjpeg->watcher);
  g_queue_unlink(tcs_http_mjpeg_viewers(mjpeg->server->http), &mjpeg->link);
  mjpeg->server->mjpeg_clients--;
  if (mjpeg->image) g_bytes_unref(mjpeg->image);
  g_string_free(mjpeg->head, TRUE);
  g_string_free(mjpeg->tail, TRUE);
  g_free(mjpeg);
}

/* Lets the kernel end the connection of a viewer that vanished (by keepalive, or by TCP_USER_TIMEOUT while pictures are
 * sent) or reads nothing (by TCP_USER_TIMEOUT). MHD notices the end, or tcs_mjpeg_tick() for suspended connections. */
static void bound_silence(struct MHD_Connection *connection, int64_t seconds) {
  const int fd = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
  const int one = 1, idle = (int)seconds, between = (int)MAX(1, seconds / 3), times = 3;
  const unsigned unacknowledged_ms = (unsigned)seconds * 1000;
  setsockopt(fd, SOL_SOCKET, SO_KEEPALIVE, &one, sizeof one);
  setsockopt(fd, IPPROTO_TCP, TCP_KEEPIDLE, &idle, sizeof idle);
  setsockopt(fd, IPPROTO_TCP, TCP_KEEPINTVL, &between, sizeof between);
  setsockopt(fd, IPPROTO_TCP, TCP_KEEPCNT, &times, sizeof times);
  setsockopt(fd, IPPROTO_TCP, TCP_USER_TIMEOUT, &unacknowledged_ms, sizeof unacknowledged_ms);
}

static void open_stream(tcs_request *request, tcs_session *session) {
  tcs_server *server = request->server;
  tcs_mjpeg *mjpeg = g_new0(tcs_mjpeg, 1);
  mjpeg->server = server;
  mjpeg->connection = request->connection;
  mjpeg->caller = request->caller;
  mjpeg->watcher.ops = &mjpeg_ops;
  mjpeg->head = g_string_new(NULL);
  mjpeg->tail = g_string_new(NULL);
  mjpeg->link.data = mjpeg;
  g_queue_push_tail_link(tcs_http_mjpeg_viewers(server->http), &mjpeg->link);
  server->mjpeg_clients++;
  open_part(mjpeg->head, mjpeg, session->scene.image.format == TC_FORMAT_PNG ? "png" : "jpeg");
  struct MHD_Response *response =
      MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, BLOCK, read_stream, mjpeg, free_stream);
  if (!response) {
    free_stream(mjpeg);
    request->cut = true;
    return;
  }
  tcs_reply_response(request, 200, response);
  tcs_reply_header(request, "Content-Type", "multipart/x-mixed-replace; boundary=tomocast");
  bound_silence(request->connection, server->config->limits.blocked_seconds);
  tcs_session_join(session, &mjpeg->watcher, 1);
  tcs_audit(server->access, &request->caller, "session.join", session->id, session->entry->id);
}

void tcs_get_mjpeg(tcs_request *request) {
  tcs_session *session = tcs_session_of(request);
  if (!session) return;
  if (strcmp(request->method, "HEAD") == 0) {
    tcs_reply_empty(request, 200);
    tcs_reply_header(request, "Content-Type", "multipart/x-mixed-replace; boundary=tomocast");
  } else if (tcs_viewer_fits(request, session)) {
    open_stream(request, session);
  }
}

void tcs_mjpeg_tick(tcs_server *server) {
  for (GList *item = tcs_http_mjpeg_viewers(server->http)->head; item; item = item->next) {
    tcs_mjpeg *mjpeg = item->data;
    const bool over = !tcs_access_lasts(server->access, &mjpeg->caller);
    if (over || (mjpeg->suspended && tcs_peer_gone(mjpeg->connection))) on_end(&mjpeg->watcher);
  }
}

void tcs_mjpeg_end_all(tcs_server *server) {
  for (GList *item = tcs_http_mjpeg_viewers(server->http)->head; item; item = item->next)
    on_end(&((tcs_mjpeg *)item->data)->watcher);
}
