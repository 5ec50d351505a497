/* The HTTP side: libmicrohttpd's life cycle, requests and replies. I/O thread only. */
#ifndef TCS_HTTP_HTTP_H
#define TCS_HTTP_HTTP_H

#include <cjson/cJSON.h>
#include <microhttpd.h>

#include "server/access/role.h"
#include "server/catalogue/catalogue.h"
#include "server/config/config.h"
#include "server/http/route.h"
#include "server/observe/log.h"
#include "server/observe/metrics.h"
#include "server/ws/stream.h"

typedef struct tcs_upload tcs_upload;

/* One request from its headers to its reply. A handler either replies or defers: then something keeps the request and
 * replies later, from the I/O thread. */
struct tcs_request {
  tcs_server *server;
  struct MHD_Connection *connection;
  const tcs_route *route; /* NULL: no such path or method */
  char params[TCS_MAX_PARAMS][TCS_PARAM_SIZE];
  char method[12];
  unsigned number; /* of the connection's requests, from 1 */
  tcs_caller caller;
  GByteArray *body;
  uint64_t body_bytes; /* so far, kept or not */
  tcs_upload *upload;
  int64_t began_us;
  bool body_complete;
  bool deferred, suspended;
  GList deferred_link;
  struct MHD_Response *reply;
  const char *problem; /* the reply's text; NULL: it is none */
  int status;
  bool cut;         /* close the connection without a reply */
  bool for_metrics; /* came where nothing but the metrics are, for everybody */

  /* While deferred: the client has gone. Whoever defers must forget the request here. */
  void (*abandon)(tcs_request *request);
  void *owner; /* the deferrer's */
};

tcs_http *tcs_http_new(tcs_server *server, GError **error);
void tcs_http_free(tcs_http *http); /* every deferred request was answered */
/* "127.0.0.1:8080": where it really listens. */
const char *tcs_http_address(const tcs_http *http);
const char *tcs_http_metrics_address(const tcs_http *http); /* "": it does not */
tcs_streams *tcs_http_streams(tcs_http *http);
GQueue *tcs_http_mjpeg_viewers(tcs_http *http); /* tcs_mjpeg */
/* Bytes that came after a request for an upgrade. */
const GByteArray *tcs_http_held(struct MHD_Connection *connection);
/* The daemon's descriptions of itself: the same for as long as the daemon runs, written when first asked for. */
typedef enum tcs_document {
  TCS_DOCUMENT_ABOUT,
  TCS_DOCUMENT_OPENAPI,
  TCS_DOCUMENT_SCENE_SCHEMA,
  TCS_DOCUMENT_PRESETS,
  TCS_DOCUMENT_COUNT
} tcs_document;
GBytes *tcs_http_document(tcs_http *http, tcs_document which); /* the http's */
GBytes *tcs_document_write(const tcs_server *server, tcs_document which); /* api_service.c */
/* Lets MHD work; milliseconds until it wants to again, -1 = no hurry. */
int tcs_http_run(tcs_http *http);
/* Once a second: deadlines, clients that left while waiting. */
void tcs_http_tick(tcs_http *http, int64_t now_us);
/* In the middle of a body, where the library takes no reply: sends the problem that the request has got past it, and
 * ends the connection. */
void tcs_http_cut(tcs_request *request);
/* Takes no new connections any more. */
void tcs_http_quiesce(tcs_http *http);
/* Requests and MJPEG viewers that are not finished. */
int tcs_http_open_requests(const tcs_http *http);
void tcs_http_abandon_all(tcs_http *http);

/* --- replies: one per request ---------------------------------------------------------------------- */

void tcs_reply_json(tcs_request *request, int status, cJSON *json); /* takes json */
void tcs_reply_error(tcs_request *request, const GError *error);
/* For a document inside the body: `prefix` ("/scene") goes before the error's pointer. */
void tcs_reply_error_in(tcs_request *request, const GError *error, const char *prefix);
/* A problem that is no GError: `code` completes "urn:tomocast:problem:". */
void tcs_reply_problem(tcs_request *request, int status, const char *code, const char *title, const char *detail);
void tcs_reply_bytes(tcs_request *request, int status, const char *type, GBytes *bytes); /* takes bytes */
void tcs_reply_text(tcs_request *request, int status, const char *type, char *text);     /* takes g_malloc'ed text */
void tcs_reply_empty(tcs_request *request, int status);
void tcs_reply_draining(tcs_request *request); /* 503 */
/* An MHD response of the caller's own making. */
void tcs_reply_response(tcs_request *request, int status, struct MHD_Response *response);
/* After a reply was made. */
void tcs_reply_header(tcs_request *request, const char *name, const char *value);

/* Replies later; may be called again, with what it now waits for. */
void tcs_defer(tcs_request *request, void (*abandon)(tcs_request *request), void *owner);

/* --- reading a request ------------------------------------------------------------------------------ */

const char *tcs_header(const tcs_request *request, const char *name); /* NULL: absent */
const char *tcs_query(const tcs_request *request, const char *name);  /* NULL: absent */
/* A whole number from the query; *value stays when it is absent. False: replied 422. */
bool tcs_query_int(tcs_request *request, const char *name, int least, int most, int *value);
/* Who asks, for all that counts by client: an address (access/proxies.h) and a token. g_malloc'ed; never logged. */
char *tcs_peer_name(const tcs_request *request);
/* The body as JSON. NULL: replied 400. */
cJSON *tcs_body_json(tcs_request *request);
/* True when `etag` (with its quotes) is in a header's list, or the header is "*". */
bool tcs_etag_listed(const char *header, const char *etag);

/* The resident volume `id`, or NULL: replied 404 or 409. member: pointer to who named it in the body, or NULL. */
struct tcs_entry *tcs_resident(tcs_request *request, const char *id, const char *member);
/* The session of the first parameter, or NULL: replied 404: there is none that the caller may know of. */
tcs_session *tcs_session_of(tcs_request *request);
/* The same for what only its owner may do, or NULL: replied 403 too. */
tcs_session *tcs_own_session(tcs_request *request);
/* Whether the caller may know of a session, be it one that is none; of a volume or mesh: all but those who were given
 * one session may know of all. */
bool tcs_session_visible(const tcs_request *request, const char *id);
bool tcs_entry_visible(const tcs_request *request, tcs_kind kind, const char *id);
/* Whether one more may look at it. Full of viewers, the house still takes the first of each session: one user's keep
 * nobody else out. False: replied 503. */
bool tcs_viewer_fits(tcs_request *request, const tcs_session *session);
/* False: replied 422, naming a member that is not in the NULL-ended list `names`. Also wants an object. */
bool tcs_members_known(tcs_request *request, const cJSON *body, const char *const *names);
/* A string member; NULL where absent. False: replied 422. */
bool tcs_member_string(tcs_request *request, const cJSON *body, const char *name, bool required, const char **value);

/* Content-Type and Content-Length against the route, before the body is read. False: replied. */
bool tcs_body_acceptable(tcs_request *request);

/* --- the table ------------------------------------------------------------------------------------- */

extern const tcs_route tcs_routes[];

/* What this version answers with TC_ERROR_UNSUPPORTED: values by the dotted path of their member. Any thread. */
cJSON *tcs_unavailable(void);

/* Handlers, by file. */
void tcs_get_healthz(tcs_request *request);
void tcs_get_readyz(tcs_request *request);
void tcs_get_metrics(tcs_request *request);
void tcs_get_about(tcs_request *request);
void tcs_get_openapi(tcs_request *request);
void tcs_get_scene_schema(tcs_request *request);
void tcs_get_presets(tcs_request *request);
void tcs_get_entries(tcs_request *request);
void tcs_post_entry(tcs_request *request);
void tcs_put_entry(tcs_request *request);
void tcs_get_entry(tcs_request *request);
void tcs_get_series(tcs_request *request);
void tcs_delete_entry(tcs_request *request);
void tcs_get_histogram(tcs_request *request);
void tcs_get_value(tcs_request *request);
void tcs_get_thumbnail(tcs_request *request);
void tcs_post_render(tcs_request *request);
void tcs_get_sessions(tcs_request *request);
void tcs_post_sessions(tcs_request *request);
void tcs_get_session(tcs_request *request);
void tcs_patch_session(tcs_request *request);
void tcs_delete_session(tcs_request *request);
void tcs_get_scene(tcs_request *request);
void tcs_put_scene(tcs_request *request);
void tcs_patch_scene(tcs_request *request);
void tcs_get_frame(tcs_request *request);
void tcs_get_plan(tcs_request *request);
void tcs_get_ray(tcs_request *request);
void tcs_get_pick(tcs_request *request);
typedef struct tcs_pixel {
  int x, y, width, height; /* in a picture of this size */
} tcs_pixel;
/* The pick of a session in mode mesh, of what its last picture was drawn from; with surfaces in a volume, of both. */
void tcs_pick_surface(tcs_request *request, const struct tcs_session *session, const tcs_pixel *at);
/* Goes on with it: replies what the volume shows, where that is nearer than distance_mm, or else `surface`, which it takes;
 * surface NULL: there is none. */
void tcs_pick_within(tcs_request *request, cJSON *surface, double distance_mm);
void tcs_get_stream(tcs_request *request);
void tcs_get_mjpeg(tcs_request *request);
void tcs_get_static(tcs_request *request);
void tcs_post_tickets(tcs_request *request);
void tcs_post_share(tcs_request *request);

/* --- uploads (upload.c) ------------------------------------------------------------------------------ */

/* A file in the spool folder for the body. NULL: replied. */
tcs_upload *tcs_upload_begin(tcs_request *request);
/* Whether a body for its path may come: why not is an error. */
bool tcs_put_allowed(const tcs_request *request, const char *client, GError **error);
/* Takes bytes of the body; suspends the connection while too many wait to be written. Where they cannot be kept the
 * request's reply is set. */
void tcs_upload_write(tcs_request *request, const void *bytes, size_t size);
/* The body is complete: once all of it is written tcs_put_entry_done() is called; until then the request is deferred.
 */
void tcs_upload_end(tcs_request *request);
void tcs_put_entry_done(tcs_request *request, struct tcs_spooled *file); /* takes the file */
/* The request ends: removes the rest of its upload. */
void tcs_upload_leave(tcs_request *request);
/* Once a second: ends uploads slower than the configured rate. */
void tcs_uploads_tick(tcs_server *server, int64_t now_us);
/* Answers requests whose bodies are incomplete: the server is about to end. */
void tcs_uploads_drain(tcs_server *server);
/* Ends all uploads: the loop is about to end. */
void tcs_uploads_abandon(tcs_server *server);

#endif
