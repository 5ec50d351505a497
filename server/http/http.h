/* HTTP: libmicrohttpd's life cycle, requests and replies. I/O thread only. */
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

/* One request, from its headers to its reply. A handler either replies or defers; a deferred request is kept by its
 * owner, which replies later from the I/O thread. */
struct tcs_request {
  tcs_server *server;
  struct MHD_Connection *connection;
  const tcs_route *route; /* NULL: no such path or method */
  char params[TCS_MAX_PARAMS][TCS_PARAM_SIZE];
  char method[12];
  unsigned number; /* number of this request on its connection, from 1 */
  tcs_caller caller;
  GByteArray *body;
  uint64_t body_bytes; /* received so far, kept or dropped */
  tcs_upload *upload;
  int64_t began_us;
  bool body_complete;
  bool deferred, suspended;
  GList deferred_link;
  struct MHD_Response *reply;
  const char *problem; /* the text of a problem reply; NULL: another reply */
  int status;
  bool cut;         /* close the connection without a reply */
  bool for_metrics; /* came over the metrics address, where everybody may read the metrics and nothing else */

  /* Called when the client of a deferred request has left; the owner must forget the request. */
  void (*abandon)(tcs_request *request);
  void *owner; /* for the owner of a deferred request */
};

tcs_http *tcs_http_new(tcs_server *server, GError **error);
void tcs_http_free(tcs_http *http); /* after every deferred request was answered */
/* The actual listening address, such as "127.0.0.1:8080". */
const char *tcs_http_address(const tcs_http *http);
const char *tcs_http_metrics_address(const tcs_http *http); /* "": none */
tcs_streams *tcs_http_streams(tcs_http *http);
GQueue *tcs_http_mjpeg_viewers(tcs_http *http); /* queue of tcs_mjpeg */
/* Bytes received after an upgrade request. */
const GByteArray *tcs_http_held(struct MHD_Connection *connection);
/* Descriptions of the daemon, constant while it runs, written when first requested. */
typedef enum tcs_document {
  TCS_DOCUMENT_ABOUT,
  TCS_DOCUMENT_OPENAPI,
  TCS_DOCUMENT_SCENE_SCHEMA,
  TCS_DOCUMENT_PRESETS,
  TCS_DOCUMENT_COUNT
} tcs_document;
GBytes *tcs_http_document(tcs_http *http, tcs_document which);            /* owned by http */
GBytes *tcs_document_write(const tcs_server *server, tcs_document which); /* api_service.c */
/* Runs MHD. Returns milliseconds until it needs to run again, -1 = not before there is input. */
int tcs_http_run(tcs_http *http);
/* Once a second: deadlines, and deferred clients that left. */
void tcs_http_tick(tcs_http *http, int64_t now_us);
/* Ends a request in the middle of its body, where the library accepts no reply: sends the request's problem past the
 * library and closes the connection. */
void tcs_http_cut(tcs_request *request);
/* Stops accepting connections. */
void tcs_http_quiesce(tcs_http *http);
/* Number of unfinished requests, including MJPEG viewers. */
int tcs_http_open_requests(const tcs_http *http);
void tcs_http_abandon_all(tcs_http *http);

/* --- replies: one per request ---------------------------------------------------------------------- */

void tcs_reply_json(tcs_request *request, int status, cJSON *json); /* takes json */
void tcs_reply_error(tcs_request *request, const GError *error);
/* For an error in a document inside the body: `prefix` ("/scene") is prepended to the error's pointer. */
void tcs_reply_error_in(tcs_request *request, const GError *error, const char *prefix);
/* A problem without a GError: `code` completes "urn:tomocast:problem:". */
void tcs_reply_problem(tcs_request *request, int status, const char *code, const char *title, const char *detail);
void tcs_reply_bytes(tcs_request *request, int status, const char *type, GBytes *bytes); /* takes bytes */
void tcs_reply_text(tcs_request *request, int status, const char *type, char *text);     /* takes g_malloc'ed text */
void tcs_reply_empty(tcs_request *request, int status);
void tcs_reply_draining(tcs_request *request); /* 503 */
/* Replies with an MHD response; takes it. */
void tcs_reply_response(tcs_request *request, int status, struct MHD_Response *response);
/* Adds a header; only after the reply was set. */
void tcs_reply_header(tcs_request *request, const char *name, const char *value);

/* Replies later. May be called again with a new owner. */
void tcs_defer(tcs_request *request, void (*abandon)(tcs_request *request), void *owner);

/* --- reading a request ------------------------------------------------------------------------------ */

const char *tcs_header(const tcs_request *request, const char *name); /* NULL: absent */
const char *tcs_query(const tcs_request *request, const char *name);  /* NULL: absent */
/* An integer of the query; *value is unchanged if absent. False: replied 422. */
bool tcs_query_int(tcs_request *request, const char *name, int least, int most, int *value);
/* Name of the client for everything counted by client: its address (access/proxies.h) and its token. g_malloc'ed; never
 * logged. */
char *tcs_peer_name(const tcs_request *request);
/* The body as JSON. NULL: replied 400. */
cJSON *tcs_body_json(tcs_request *request);
/* True when `etag` (with its quotes) is in a header's list, or the header is "*". */
bool tcs_etag_listed(const char *header, const char *etag);

/* The resident volume `id`, or NULL: replied 404 or 409. member: JSON pointer to the id in the body, or NULL. */
struct tcs_entry *tcs_resident(tcs_request *request, const char *id, const char *member);
/* The session of the first path parameter. NULL: replied 404, if it does not exist or the caller may not see it. */
tcs_session *tcs_session_of(tcs_request *request);
/* Like tcs_session_of(), for the owner only. NULL: replied 404 or 403. */
tcs_session *tcs_own_session(tcs_request *request);
/* Whether the caller may see a session, volume or mesh; false for a session that does not exist. Volumes and meshes are
 * visible to every caller, but a caller bound to one session (by a link or ticket) sees only those of the session. */
bool tcs_session_visible(const tcs_request *request, const char *id);
bool tcs_entry_visible(const tcs_request *request, tcs_kind kind, const char *id);
/* Whether one more viewer may join. At the limit each session still gets its first viewer, so that one user's viewers
 * do not shut out others. False: replied 503. */
bool tcs_viewer_fits(tcs_request *request, const tcs_session *session);
/* Checks that the body is an object with members from the NULL-ended list `names`. False: replied 422. */
bool tcs_members_known(tcs_request *request, const cJSON *body, const char *const *names);
/* A string member; *value is NULL if absent. False: replied 422. */
bool tcs_member_string(tcs_request *request, const cJSON *body, const char *name, bool required, const char **value);

/* Checks Content-Type and Content-Length against the route, before the body is read. False: replied. */
bool tcs_body_acceptable(tcs_request *request);

/* --- the table ------------------------------------------------------------------------------------- */

extern const tcs_route tcs_routes[];

/* What this version answers with TC_ERROR_UNSUPPORTED: the values by the dotted path of their member. Any thread. */
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
  int x, y, width, height; /* in a picture of width x height */
} tcs_pixel;
/* Picks the drawn surface: in mode mesh, or of surfaces within a volume. */
void tcs_pick_surface(tcs_request *request, const struct tcs_session *session, const tcs_pixel *at);
/* Continues a pick: replies the volume's hit if it is nearer than distance_mm, else `surface`, which it takes. surface
 * NULL: no surface was hit. */
void tcs_pick_within(tcs_request *request, cJSON *surface, double distance_mm);
void tcs_get_stream(tcs_request *request);
void tcs_get_mjpeg(tcs_request *request);
void tcs_get_static(tcs_request *request);
void tcs_post_tickets(tcs_request *request);
void tcs_post_share(tcs_request *request);

/* --- uploads (upload.c) ------------------------------------------------------------------------------ */

/* Opens a file in the spool for the body. NULL: replied. */
tcs_upload *tcs_upload_begin(tcs_request *request);
/* Whether the client may upload to the request's path; else the error. */
bool tcs_put_allowed(const tcs_request *request, const char *client, GError **error);
/* Takes bytes of the body; suspends the connection while too many wait to be written. If they cannot be stored, sets
 * the request's reply. */
void tcs_upload_write(tcs_request *request, const void *bytes, size_t size);
/* The body is complete. Defers the request until everything is written, then calls tcs_put_entry_done(). */
void tcs_upload_end(tcs_request *request);
void tcs_put_entry_done(tcs_request *request, struct tcs_spooled *file); /* takes the file */
/* The request ends: removes its unfinished upload. */
void tcs_upload_leave(tcs_request *request);
/* Once a second: ends uploads below the configured rate. */
void tcs_uploads_tick(tcs_server *server, int64_t now_us);
/* At shutdown: replies to requests whose bodies are incomplete. */
void tcs_uploads_drain(tcs_server *server);
/* At the end of the loop: ends all uploads. */
void tcs_uploads_abandon(tcs_server *server);

#endif
