#include "server/http/http.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netdb.h>
#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "server/access/access.h"
#include "server/http/admission.h"
#include "server/http/guard.h"
#include "server/http/linger.h"
#include "server/http/mjpeg.h"
#include "server/loop/loop.h"

#define IDLE_S 30                /* limit on a connection's silence */
#define HEADER_US 10000000       /* from accept to the end of the headers, even if they arrive slowly */
#define NEXT_REQUEST_US 40000000 /* from the end of a request to the end of the next one's headers */
#define BODY_US 60000000         /* for a JSON body */
#define DROP_BYTES (4 << 20)     /* limit on a body the route does not use */
#define EXTRA_CONNECTIONS 512    /* besides the viewers */
#define METRICS_CONNECTIONS 16
#define RESERVE 64         /* of these: only for lookups, and short-lived */
#define RESERVE_US 2000000 /* for the headers on such a connection */

/* State of a connection, from accept to close. */
typedef struct link {
  int fd;
  unsigned answered;    /* number of requests answered */
  int64_t deadline_us;  /* 0 = none */
  tcs_strict *strict;   /* owned by the guard */
  tcs_request *reading; /* the request whose body is being received, or NULL */
  unsigned requests;    /* number of requests begun */
  bool reserve;         /* one of the last connections free, in all or for its peer */
  char peer[INET6_ADDRSTRLEN]; /* "": a trusted proxy, not limited as one peer */
  bool gone;                   /* the peer was gone at the last tick */
  bool metrics;                /* accepted on the metrics address */
} link_state;

/* A listening address. */
typedef struct place {
  tcs_http *http;
  struct MHD_Daemon *daemon;
  tcs_source source; /* MHD's own epoll descriptor */
  char address[INET6_ADDRSTRLEN + 16];
} place;

enum { MAIN, METRICS, PLACES };

struct tcs_http {
  tcs_server *server;
  place places[PLACES]; /* the metrics place may have no daemon */
  tcs_streams *streams;
  GHashTable *links; /* set of link_state * */
  tcs_guard *guard;
  tcs_linger *linger;
  GQueue deferred; /* tcs_request *, by deferred_link */
  GQueue mjpeg_viewers;
  GBytes *documents[TCS_DOCUMENT_COUNT]; /* NULL: not yet requested */
  int open_requests;
};

const char *tcs_http_address(const tcs_http *http) { return http->places[MAIN].address; }
const char *tcs_http_metrics_address(const tcs_http *http) { return http->places[METRICS].address; }
tcs_streams *tcs_http_streams(tcs_http *http) { return http->streams; }
GBytes *tcs_http_document(tcs_http *http, tcs_document which) {
  if (!http->documents[which]) http->documents[which] = tcs_document_write(http->server, which);
  return http->documents[which];
}
GQueue *tcs_http_mjpeg_viewers(tcs_http *http) { return &http->mjpeg_viewers; }

static link_state *link_of(struct MHD_Connection *connection) {
  const union MHD_ConnectionInfo *info = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_SOCKET_CONTEXT);
  return info ? info->socket_context : NULL;
}

static void set_deadline(struct MHD_Connection *connection, int64_t from_now_us) {
  link_state *link = link_of(connection);
  if (link) link->deadline_us = from_now_us ? g_get_monotonic_time() + from_now_us : 0;
}

static unsigned connection_limit(const tcs_server *server) {
  return (unsigned)(server->config->limits.clients + EXTRA_CONNECTIONS);
}

/* Limit on one peer's connections, so that its idle ones do not shut out others: three times the number left. However
 * many peers reach their limit, some connections stay free. */
static unsigned peer_limit(const tcs_http *http) {
  const unsigned taken = g_hash_table_size(http->links) + RESERVE, limit = connection_limit(http->server);
  return taken < limit ? 3 * (limit - taken) : 0;
}

static void name_peer(const tcs_http *http, const struct sockaddr *from, char peer[INET6_ADDRSTRLEN]) {
  const tcs_proxies *proxies = http->server->access->proxies;
  *peer = 0;
  if (!tcs_proxies_trust(proxies, from)) tcs_proxies_peer(proxies, from, NULL, NULL, peer);
}

static unsigned connections_of(const tcs_http *http, const char *peer) {
  unsigned count = 0;
  GHashTableIter all;
  g_hash_table_iter_init(&all, http->links);
  for (gpointer link; *peer && g_hash_table_iter_next(&all, &link, NULL);)
    count += strcmp(((const link_state *)link)->peer, peer) == 0;
  return count;
}

static enum MHD_Result on_accept(void *user, const struct sockaddr *from, socklen_t size) {
  const tcs_http *http = ((const place *)user)->http;
  char peer[INET6_ADDRSTRLEN];
  name_peer(http, from, peer);
  return connections_of(http, peer) < peer_limit(http) + RESERVE / 2 ? MHD_YES : MHD_NO;
}

static bool is_reserve(const tcs_http *http, const link_state *link) {
  return g_hash_table_size(http->links) + RESERVE >= connection_limit(http->server) ||
         connections_of(http, link->peer) >= peer_limit(http);
}

static void on_connection(void *user, struct MHD_Connection *connection, void **context,
                          enum MHD_ConnectionNotificationCode code) {
  const place *at = user;
  tcs_http *http = at->http;
  if (code == MHD_CONNECTION_NOTIFY_STARTED) {
    link_state *link = g_new0(link_state, 1);
    link->fd = MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd;
    link->metrics = at == &http->places[METRICS];
    if (!link->metrics) name_peer(http, MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS)->client_addr, link->peer);
    link->reserve = !link->metrics && is_reserve(http, link);
    link->deadline_us = g_get_monotonic_time() + (link->reserve ? RESERVE_US : HEADER_US);
    link->strict = tcs_guard_add(http->guard, link->fd);
    g_hash_table_add(http->links, link);
    *context = link;
  } else if (*context) {
    tcs_guard_remove(http->guard, ((link_state *)*context)->fd);
    tcs_linger_add(http->linger, ((link_state *)*context)->fd);
    g_hash_table_remove(http->links, *context);
    g_free(*context);
    *context = NULL;
  }
}

/* --- one request ----------------------------------------------------------------------------------- */

/* Whether the request is the last one that passed the guard, so that the guard's refusal or upgrade is about it. */
static bool is_newest(const tcs_request *request) {
  return request->number == tcs_strict_heads(link_of(request->connection)->strict);
}

/* True: the guard refused the request; replied. */
static bool refuse_framing(tcs_request *request) {
  const tcs_refusal *refusal = tcs_strict_refusal(link_of(request->connection)->strict);
  if (!refusal || !is_newest(request)) return false;
  tcs_reply_problem(request, refusal->status, refusal->code, refusal->title, refusal->detail);
  return true;
}

const GByteArray *tcs_http_held(struct MHD_Connection *connection) {
  return tcs_strict_held(link_of(connection)->strict);
}

/* All checks before the body is read. */
static void admit(tcs_request *request, const char *path) {
  tcs_server *server = request->server;
  tcs_match match;
  if (refuse_framing(request)) return;
  tcs_route_match(tcs_routes, request->method, path, &match);
  request->route = match.route;
  memcpy(request->params, match.params, sizeof match.params);
  if (!tcs_admit_host(request)) return;
  if (strcmp(path, "*") == 0) {
    tcs_reply_problem(request, 405, "method", "Method not allowed", "ask for one path's methods");
    tcs_reply_header(request, "Allow", "GET, HEAD, POST, PUT, PATCH, DELETE");
  } else if ((!match.route && !match.path_known) || (request->for_metrics && strcmp(path, "/metrics") != 0)) {
    tcs_reply_problem(request, 404, "not-found", "Not found", "there is nothing at this path");
  } else if (!match.route) {
    tcs_reply_problem(request, 405, "method", "Method not allowed", "the Allow header lists the methods of this path");
    tcs_reply_header(request, "Allow", match.allow);
  } else if (!tcs_admit_origin(request) || !tcs_admit_caller(request)) {
    return;
  } else if (server->draining && match.route->cost != TCS_COST_LOOKUP) {
    tcs_reply_draining(request);
  } else if (link_of(request->connection)->reserve && match.route->cost != TCS_COST_LOOKUP) {
    tcs_reply_problem(request, 503, "busy", "Busy", "too many connections; try again later");
    tcs_reply_header(request, "Retry-After", "2");
  } else if (tcs_body_acceptable(request) && match.route->body == TCS_BODY_FILE) {
    request->upload = tcs_upload_begin(request);
  }
}

static void take_body(tcs_request *request, const void *bytes, size_t size) {
  const tcs_limits *limits = &request->server->config->limits;
  const bool wanted = request->route->body != TCS_BODY_NONE;
  const uint64_t most = wanted ? (uint64_t)limits->body_bytes : DROP_BYTES;
  request->body_bytes += size;
  if (request->upload)
    tcs_upload_write(request, bytes, size);
  else if (request->body_bytes > most)
    tcs_reply_problem(request, 413, "limit", "Too large", "the body is over the limit, which /v1/about shows");
  else if (wanted)
    g_byte_array_append(request->body, bytes, (guint)size);
}

static void account(const tcs_request *request) {
  const double seconds = (double)(g_get_monotonic_time() - request->began_us) / 1e6;
  const char *pattern = request->route ? request->route->pattern : "none";
  tcs_metrics_request(request->server->metrics, request->route ? request->method : "other", pattern, request->status,
                      seconds);
  tcs_log(request->status >= 500 && request->status != 503 && request->status != 501 ? TCS_LOG_WARN : TCS_LOG_DEBUG,
          "http.reply", "method=%s route=%s status=%d ms=%.1f", request->method, pattern, request->status,
          seconds * 1000);
}

static bool body_is_left(const tcs_request *request) {
  const char *length = tcs_header(request, "Content-Length");
  return !request->body_complete &&
         (length ? strcmp(length, "0") != 0 : tcs_header(request, "Transfer-Encoding") != NULL);
}

/* The connection closes after a refusal, an upgrade not granted, or a body not read. */
static bool is_last(const tcs_request *request) {
  const link_state *link = link_of(request->connection);
  return (is_newest(request) && !tcs_strict_hungry(link->strict)) || link->reserve || body_is_left(request);
}

static enum MHD_Result hand_over(tcs_request *request) {
  account(request);
  if (request->status != 101 && is_last(request)) tcs_reply_header(request, "Connection", "close");
  tcs_shield(request);
  return MHD_queue_response(request->connection, (unsigned)request->status, request->reply);
}

static enum MHD_Result put_header(void *text, enum MHD_ValueKind kind, const char *name, const char *value) {
  g_string_append_printf(text, "%s: %s\r\n", name, value);
  return MHD_YES;
}

static GString *write_reply(const tcs_request *request) {
  GDateTime *now = g_date_time_new_now_utc();
  char *date = g_date_time_format(now, "%a, %d %b %Y %H:%M:%S GMT");
  GString *text = g_string_new(NULL);
  g_string_printf(text, "HTTP/1.1 %d %s\r\nDate: %s\r\nConnection: close\r\nContent-Length: %zu\r\n", request->status,
                  MHD_get_reason_phrase_for((unsigned)request->status), date, strlen(request->problem));
  MHD_get_response_headers(request->reply, put_header, text);
  g_string_append_printf(text, "\r\n%s", strcmp(request->method, "HEAD") == 0 ? "" : request->problem);
  g_free(date);
  g_date_time_unref(now);
  return text;
}

void tcs_http_cut(tcs_request *request) {
  const int fd = link_of(request->connection)->fd;
  if (request->cut) return;
  request->cut = true;
  account(request);
  tcs_shield(request);
  GString *text = write_reply(request);
  (void)send(fd, text->str, text->len, MSG_NOSIGNAL | MSG_DONTWAIT);
  shutdown(fd, SHUT_WR);
  g_string_free(text, TRUE);
}

static tcs_request *new_request(tcs_http *http, struct MHD_Connection *connection, const char *method) {
  tcs_request *request = g_new0(tcs_request, 1);
  request->server = http->server;
  request->connection = connection;
  request->number = ++link_of(connection)->requests;
  request->for_metrics = link_of(connection)->metrics;
  request->body = g_byte_array_new();
  request->began_us = g_get_monotonic_time();
  g_strlcpy(request->method, method, sizeof request->method);
  request->deferred_link.data = request;
  http->open_requests++;
  return request;
}

static enum MHD_Result on_request(void *user, struct MHD_Connection *connection, const char *path, const char *method,
                                  const char *version, const char *bytes, size_t *size, void **context) {
  tcs_http *http = user;
  tcs_request *request = *context;
  if (!request) {
    *context = request = new_request(http, connection, method);
    if (request->number > tcs_strict_heads(link_of(connection)->strict)) {
      tcs_log(TCS_LOG_ERROR, "http.unguarded", "text=\"the HTTP library received bytes that were not checked\"");
      return MHD_NO;
    }
    admit(request, path);
    set_deadline(connection, request->upload ? 0 : BODY_US);
    if (request->reply && body_is_left(request)) return hand_over(request); /* the body stays unread */
    link_of(connection)->reading = request;
    return MHD_YES;
  }
  if (request->cut) return MHD_NO;
  if (*size > 0) {
    take_body(request, bytes, *size);
    *size = 0;
    if (request->reply) tcs_http_cut(request);
    return request->cut ? MHD_NO : MHD_YES;
  }
  if (!request->body_complete) {
    request->body_complete = true;
    link_of(connection)->reading = NULL;
    set_deadline(connection, 0);
    if (!request->reply && !refuse_framing(request)) request->route->handler(request);
  }
  if (request->cut) return MHD_NO;
  if (request->reply) return hand_over(request);
  if (!request->deferred) return MHD_NO; /* no reply and not deferred: close rather than hang */
  request->suspended = true;
  MHD_suspend_connection(connection);
  return MHD_YES;
}

static void forget_deferral(tcs_request *request) {
  if (!request->deferred) return;
  request->deferred = false;
  g_queue_unlink(&request->server->http->deferred, &request->deferred_link);
}

static void on_completed(void *user, struct MHD_Connection *connection, void **context,
                         enum MHD_RequestTerminationCode code) {
  tcs_http *http = user;
  tcs_request *request = *context;
  if (!request) return;
  *context = NULL;
  link_of(connection)->answered++;
  link_of(connection)->reading = NULL;
  if (request->deferred && request->abandon) request->abandon(request);
  forget_deferral(request);
  if (request->reply) MHD_destroy_response(request->reply);
  tcs_upload_leave(request);
  g_byte_array_unref(request->body);
  g_free(request);
  http->open_requests--;
  set_deadline(connection, NEXT_REQUEST_US);
}

void tcs_defer(tcs_request *request, void (*abandon)(tcs_request *request), void *owner) {
  request->abandon = abandon;
  request->owner = owner;
  if (request->deferred) return; /* deferred again by another owner */
  request->deferred = true;
  g_queue_push_tail_link(&request->server->http->deferred, &request->deferred_link);
}

static void wake(tcs_request *request) {
  forget_deferral(request);
  if (!request->suspended) return;
  request->suspended = false;
  request->server->http_work = true;
  MHD_resume_connection(request->connection);
}

void tcs_reply_response(tcs_request *request, int status, struct MHD_Response *response) {
  if (request->reply) MHD_destroy_response(request->reply);
  request->reply = response;
  request->problem = NULL;
  request->status = status;
  if (!response) request->cut = true; /* out of memory */
  if (request->deferred) wake(request);
}

static void abandon(tcs_request *request) {
  if (request->abandon) request->abandon(request);
  request->cut = true;
  wake(request);
}

void tcs_http_abandon_all(tcs_http *http) {
  while (http->deferred.head) abandon(http->deferred.head->data);
}

static bool ended(int fd) {
  char byte;
  const ssize_t got = recv(fd, &byte, 1, MSG_PEEK | MSG_DONTWAIT);
  return got == 0 || (got < 0 && errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR);
}

bool tcs_peer_gone(struct MHD_Connection *connection) {
  return ended(MHD_get_connection_info(connection, MHD_CONNECTION_INFO_CONNECTION_FD)->connect_fd);
}

/* Whether the connection is past its deadline or its peer has gone. MHD misses an end of the connection that arrived
 * with the last bytes, since its epoll is edge-triggered, and would wait for its timeout. Two ticks in a row, so that
 * MHD has handled all earlier bytes. */
static bool is_over(link_state *link, int64_t now_us) {
  const bool waits = link->reading ? !link->reading->suspended : link->requests == link->answered;
  const bool was_gone = link->gone;
  link->gone = waits && ended(link->fd);
  return (link->deadline_us && now_us >= link->deadline_us) || (link->gone && was_gone);
}

static void time_out(tcs_request *request) {
  tcs_reply_problem(request, 408, "slow", "Too slow", "the body did not come in time");
  tcs_http_cut(request);
}

void tcs_http_tick(tcs_http *http, int64_t now_us) {
  GHashTableIter iterator;
  void *key;
  g_hash_table_iter_init(&iterator, http->links);
  while (g_hash_table_iter_next(&iterator, &key, NULL)) {
    link_state *link = key;
    if (!is_over(link, now_us)) continue;
    link->deadline_us = 0;
    if (link->reading && !link->reading->cut)
      time_out(link->reading);
    else
      shutdown(link->fd, SHUT_RDWR); /* MHD then closes */
  }
  /* MHD does not watch suspended connections, so check here whether their clients left. */
  for (GList *item = http->deferred.head, *next; item; item = next) {
    next = item->next;
    tcs_request *request = item->data;
    if (request->suspended && tcs_peer_gone(request->connection)) abandon(request);
  }
  tcs_linger_tick(http->linger, now_us);
  tcs_uploads_tick(http->server, now_us);
  tcs_mjpeg_tick(http->server);
}

/* --- life cycle ------------------------------------------------------------------------------------ */

static void on_log(void *user, const char *format, va_list arguments) {
  /* The library's text may contain parts of the request, so only the event is logged. */
  tcs_log(TCS_LOG_DEBUG, "http.library", NULL);
}

static void on_mhd_ready(tcs_source *source, uint32_t events) { /* only wakes the loop, which runs MHD in every turn */
}

static int listen_on(const tcs_listen *where, const char *option, GError **error) {
  char service[8];
  struct addrinfo hints = {.ai_flags = AI_PASSIVE | AI_NUMERICSERV, .ai_socktype = SOCK_STREAM}, *found = NULL;
  snprintf(service, sizeof service, "%d", where->port);
  const int failure = getaddrinfo(where->address, service, &hints, &found);
  if (failure) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "%s %s: %s", option, where->address, gai_strerror(failure));
    return -1;
  }
  const int fd = socket(found->ai_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0), one = 1;
  if (fd >= 0) setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &one, sizeof one);
  if (fd < 0 || bind(fd, found->ai_addr, found->ai_addrlen) != 0 || listen(fd, 1024) != 0) {
    tc_set_error(error, TC_ERROR_IO, NULL, "listen on %s:%d: %s; choose another with %s", where->address, where->port,
                 g_strerror(errno), option);
    if (fd >= 0) close(fd);
    freeaddrinfo(found);
    return -1;
  }
  freeaddrinfo(found);
  return fd;
}

static void name_address(place *at, int fd) {
  struct sockaddr_storage storage;
  socklen_t size = sizeof storage;
  char host[INET6_ADDRSTRLEN] = "", port[8] = "";
  getsockname(fd, (struct sockaddr *)&storage, &size);
  getnameinfo((struct sockaddr *)&storage, size, host, sizeof host, port, sizeof port, NI_NUMERICHOST | NI_NUMERICSERV);
  const bool v6 = storage.ss_family == AF_INET6;
  snprintf(at->address, sizeof at->address, "%s%s%s:%s", v6 ? "[" : "", host, v6 ? "]" : "", port);
}

static bool open_place(tcs_http *http, int which, const tcs_listen *where, const char *option, GError **error) {
  tcs_server *server = http->server;
  place *at = &http->places[which];
  const int fd = listen_on(where, option, error);
  if (fd < 0) return false;
  at->http = http;
  name_address(at, fd);
  tcs_hosts_listen(server->access->hosts, at->address);
  at->daemon = MHD_start_daemon(
      MHD_USE_EPOLL | MHD_ALLOW_UPGRADE | MHD_ALLOW_SUSPEND_RESUME | MHD_USE_ERROR_LOG, 0, which == MAIN ? on_accept : NULL, at, on_request,
      http,
      MHD_OPTION_EXTERNAL_LOGGER, on_log, NULL, MHD_OPTION_LISTEN_SOCKET, fd, MHD_OPTION_CONNECTION_LIMIT,
      which == MAIN ? connection_limit(server) : METRICS_CONNECTIONS, MHD_OPTION_CONNECTION_TIMEOUT, (unsigned)IDLE_S,
      MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)65536, MHD_OPTION_STRICT_FOR_CLIENT, 1, MHD_OPTION_NOTIFY_COMPLETED,
      on_completed, http, MHD_OPTION_NOTIFY_CONNECTION, on_connection, at, MHD_OPTION_END);
  if (!at->daemon) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "the HTTP library did not start");
    close(fd);
    return false;
  }
  at->source = (tcs_source){on_mhd_ready, MHD_get_daemon_info(at->daemon, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd};
  return tcs_loop_add(server->loop, &at->source, EPOLLIN, error);
}

tcs_http *tcs_http_new(tcs_server *server, GError **error) {
  const tcs_config *config = server->config;
  tcs_http *http = g_new0(tcs_http, 1);
  http->server = server;
  http->links = g_hash_table_new(NULL, NULL);
  http->guard = tcs_guard_new();
  http->linger = tcs_linger_new(server->loop);
  g_queue_init(&http->deferred);
  g_queue_init(&http->mjpeg_viewers);
  http->streams = tcs_streams_new(server);
  if (open_place(http, MAIN, &config->listen, "--listen", error) &&
      (!config->metrics.address || open_place(http, METRICS, &config->metrics, "--metrics-listen", error)))
    return http;
  tcs_http_free(http);
  return NULL;
}

void tcs_http_free(tcs_http *http) {
  if (!http) return;
  for (place *at = http->places; at < http->places + PLACES; at++) {
    if (!at->daemon) continue;
    tcs_loop_remove(http->server->loop, &at->source);
    MHD_stop_daemon(at->daemon);
  }
  tcs_streams_free(http->streams);
  for (int i = 0; i < TCS_DOCUMENT_COUNT; i++) g_bytes_unref(http->documents[i]);
  g_hash_table_destroy(http->links);
  tcs_linger_free(http->linger);
  tcs_guard_free(http->guard);
  g_free(http);
}

int tcs_http_run(tcs_http *http) {
  int wait_ms = -1;
  /* Running may resume or close other connections, which need another run, in the next turn. */
  http->server->http_work = false;
  for (place *at = http->places; at < http->places + PLACES; at++)
    if (at->daemon) tcs_guard_run(http->guard, at->daemon);
  tcs_streams_sweep(http->streams);
  if (http->server->http_work) return 0;
  for (place *at = http->places; at < http->places + PLACES; at++) {
    MHD_UNSIGNED_LONG_LONG timeout_ms;
    /* MHD's epoll is edge-triggered: a timeout of 0 is the only sign of pending work. */
    if (!at->daemon || MHD_get_timeout(at->daemon, &timeout_ms) != MHD_YES) continue;
    const int ms = timeout_ms > 1000 ? 1000 : (int)timeout_ms;
    if (wait_ms < 0 || ms < wait_ms) wait_ms = ms;
  }
  return wait_ms;
}

void tcs_http_quiesce(tcs_http *http) {
  for (place *at = http->places; at < http->places + PLACES; at++) {
    const MHD_socket fd = at->daemon ? MHD_quiesce_daemon(at->daemon) : MHD_INVALID_SOCKET;
    if (fd != MHD_INVALID_SOCKET) close(fd);
  }
}

int tcs_http_open_requests(const tcs_http *http) { return http->open_requests; }
