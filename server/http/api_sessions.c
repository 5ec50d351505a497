/* Sessions and their scenes over HTTP, and the upgrade to WebSocket. */
#include <string.h>

#include "server/access/audit.h"
#include "server/http/work.h"
#include "server/session/change.h"
#include "server/session/deliver.h"
#include "server/session/measure.h"
#include "server/session/scope.h"
#include "server/session/sessions.h"
#include "server/ws/handshake.h"

#define FEW_SESSIONS 16 /* a longer list is printed by a worker */
#define MOST_LISTS 64   /* limit on waiting lists */

static void etag_of(const tcs_session *session, char etag[32]) {
  g_snprintf(etag, 32, "\"%" PRIu64 "\"", session->revision);
}

static void add_link(cJSON *links, const char *name, const char *id, const char *rest) {
  char *path = g_strconcat("/v1/sessions/", id, rest, NULL);
  cJSON_AddStringToObject(links, name, path);
  g_free(path);
}

/* A copy of a session's properties except the scene, to be described on another thread. */
typedef struct row {
  char id[TCS_SESSION_SIZE], volume[sizeof((tcs_entry *)0)->id], etag[32];
  guint viewers;
  int64_t idle_us;
  double render_ms;
  tcp_frame_header judged; /* zeros: not measured */
  tcs_building building;
  char unmeasured[sizeof((tcs_picture *)0)->unmeasured];
} row;

static row row_of(const tcs_session *session) {
  row r = {.viewers = session->watchers->len,
           .building = tcs_session_building(session),
           .render_ms = tcs_client_render_ms(session->client)};
  const tcs_picture *judged = tcs_session_judged(session);
  g_strlcpy(r.id, session->id, sizeof r.id);
  g_strlcpy(r.volume, session->entry->id, sizeof r.volume);
  etag_of(session, r.etag);
  r.idle_us = r.viewers ? 0 : g_get_monotonic_time() - session->used_us;
  if (judged) {
    r.judged = judged->header;
    memcpy(r.unmeasured, judged->unmeasured, sizeof r.unmeasured);
  }
  return r;
}

static cJSON *describe(const row *r, bool with_scene) {
  static const char *const names[][2] = {{"self", ""},      {"scene", "/scene"},   {"frame", "/frame"},
                                         {"plan", "/plan"}, {"stream", "/stream"}, {"mjpeg", "/stream.mjpeg"}};
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "id", r->id);
  cJSON_AddStringToObject(json, "volume", r->volume);
  cJSON_AddStringToObject(json, "etag", r->etag);
  cJSON_AddNumberToObject(json, "viewers", r->viewers);
  cJSON_AddNumberToObject(json, "idleSeconds", (double)(r->idle_us / 1000000));
  cJSON_AddNumberToObject(json, "renderMs", r->render_ms);
  if (with_scene) cJSON_AddNullToObject(json, "scene"); /* placeholder for tcs_reply_scene() */
  if (r->judged.has_error)
    cJSON_AddItemToObject(json, "error", tcp_measured_error(&r->judged));
  else if (r->judged.unmeasured)
    cJSON_AddStringToObject(json, "unmeasured", r->unmeasured);
  if (r->building.stage) tcs_building_write(&r->building, cJSON_AddObjectToObject(json, "building"));
  cJSON *links = cJSON_AddObjectToObject(json, "links");
  for (size_t i = 0; i < G_N_ELEMENTS(names); i++) add_link(links, names[i][0], r->id, names[i][1]);
  return json;
}

static cJSON *describe_with_scene(const tcs_session *session) {
  const row r = row_of(session);
  return describe(&r, true);
}

typedef struct list_work {
  tcs_work work;
  const tcs_caller *caller; /* set while rows are gathered */
  GArray *rows;
} list_work;

static void run_list(tcs_work *work) {
  const GArray *rows = ((list_work *)work)->rows;
  cJSON *json = cJSON_CreateObject(), *list = cJSON_AddArrayToObject(json, "sessions");
  for (guint i = 0; i < rows->len; i++) cJSON_AddItemToArray(list, describe(&g_array_index(rows, row, i), false));
  work->text = tcs_json_text(json);
}

static void free_list(tcs_work *work) { g_array_unref(((list_work *)work)->rows); }

static void add_session(tcs_session *session, void *user) {
  const list_work *l = user;
  if (!tcs_caller_sees(l->caller, session->id, session->owner)) return;
  const row r = row_of(session);
  g_array_append_val(l->rows, r);
}

void tcs_get_sessions(tcs_request *request) {
  list_work *l = g_new0(list_work, 1);
  l->work = (tcs_work){.run = run_list, .free = free_list};
  l->rows = g_array_new(FALSE, FALSE, sizeof(row));
  l->caller = &request->caller;
  tcs_sessions_each(request->server->sessions, add_session, l);
  if (l->rows->len <= FEW_SESSIONS)
    tcs_work_inline(request, &l->work);
  else
    tcs_work_start(request, request->server->text_worker, &l->work, MOST_LISTS);
}

static void post_session(tcs_request *request, cJSON *body, const tcp_lists *lists) {
  static const char *const names[] = {"volume", "scene", NULL};
  const char *volume;
  if (!tcs_members_known(request, body, names) || !tcs_member_string(request, body, "volume", true, &volume)) return;
  tcs_entry *entry = tcs_resident(request, volume, "/volume");
  if (!entry) return;
  GError *error = NULL;
  const cJSON *scene = cJSON_GetObjectItemCaseSensitive(body, "scene");
  char *peer = tcs_peer_name(request);
  tcs_session *session = tcs_sessions_create(request->server->sessions, entry, scene, lists, peer, &error);
  g_free(peer);
  if (!session) {
    tcs_reply_error_in(request, error, "/scene");
    g_clear_error(&error);
    return;
  }
  g_strlcpy(session->owner, request->caller.name, sizeof session->owner);
  tcs_audit(request->server->access, &request->caller, "session.create", session->id, entry->id);
  char etag[32];
  char *location = g_strconcat("/v1/sessions/", session->id, NULL);
  etag_of(session, etag);
  tcs_reply_scene(request, 201, describe_with_scene(session), &session->scene, etag, location);
  g_free(location);
}

void tcs_post_sessions(tcs_request *request) {
  tcs_server *server = request->server;
  if (server->draining) {
    tcs_reply_problem(request, 503, "draining", "Shutting down", "the server is shutting down; try another or wait");
    return;
  }
  tcs_read_body(request, "scene", post_session);
}

void tcs_get_session(tcs_request *request) {
  const tcs_session *session = tcs_session_of(request);
  if (session) tcs_reply_scene(request, 200, describe_with_scene(session), &session->scene, NULL, NULL);
}

void tcs_delete_session(tcs_request *request) {
  tcs_session *session = tcs_own_session(request);
  if (!session) return;
  tcs_audit(request->server->access, &request->caller, "session.delete", session->id, NULL);
  tcs_session_end(session);
  tcs_reply_empty(request, 204);
}

static void patch_session(tcs_request *request, cJSON *body, const tcp_lists *lists) {
  static const char *const names[] = {"volume", NULL};
  const char *id;
  tcs_session *session = tcs_session_of(request);
  if (!session || !tcs_members_known(request, body, names) || !tcs_member_string(request, body, "volume", true, &id))
    return;
  GError *error = NULL;
  tcs_catalogue *catalogue = request->server->catalogue;
  const char *forbidden =
      tcs_show_forbidden(&request->caller, session, tcs_catalogue_find(catalogue, TCS_KIND_VOLUME, id));
  tcs_entry *entry = forbidden ? NULL : tcs_catalogue_resident(catalogue, TCS_KIND_VOLUME, id, "/volume", &error);
  if (forbidden)
    tcs_reply_problem(request, 403, "forbidden", "Not allowed", forbidden);
  else if (entry && tcs_session_show(session, entry, &error))
    tcs_get_session(request);
  else
    tcs_reply_error(request, error);
  g_clear_error(&error);
}

void tcs_patch_session(tcs_request *request) {
  if (tcs_session_of(request)) tcs_read_body(request, NULL, patch_session);
}

/* --- the scene -------------------------------------------------------------------------------------- */

static void reply_scene(tcs_request *request, const tcs_session *session) {
  char etag[32];
  etag_of(session, etag);
  tcs_reply_scene(request, 200, NULL, &session->scene, etag, NULL);
}

void tcs_get_scene(tcs_request *request) {
  const tcs_session *session = tcs_session_of(request);
  if (!session) return;
  char etag[32];
  etag_of(session, etag);
  if (!tcs_etag_listed(tcs_header(request, "If-None-Match"), etag)) {
    reply_scene(request, session);
    return;
  }
  tcs_reply_empty(request, 304);
  tcs_reply_header(request, "ETag", etag);
}

/* The precondition (If-Match) is checked when the change is made, however long parsing took. */
static void change_scene(tcs_request *request, const cJSON *patch, const tcp_lists *lists, bool whole) {
  tcs_session *session = tcs_session_of(request);
  if (!session) return;
  char etag[32];
  etag_of(session, etag);
  const char *if_match = tcs_header(request, "If-Match");
  if (if_match && !tcs_etag_listed(if_match, etag)) {
    tcs_reply_problem(request, 412, "precondition", "Changed in the meantime",
                      "the scene's version differs from If-Match; fetch the scene and try again");
    tcs_reply_header(request, "ETag", etag);
    return;
  }
  GError *error = NULL;
  const char *forbidden = tcs_patch_forbidden(&request->caller, session, patch);
  if (forbidden)
    tcs_reply_problem(request, 403, "forbidden", "Not allowed", forbidden);
  else if (tcs_session_patch(session, patch, lists, whole, &error))
    reply_scene(request, session);
  else
    tcs_reply_error(request, error);
  g_clear_error(&error);
}

static void put_scene(tcs_request *request, cJSON *body, const tcp_lists *lists) {
  change_scene(request, body, lists, true);
}

static void patch_scene(tcs_request *request, cJSON *body, const tcp_lists *lists) {
  change_scene(request, body, lists, false);
}

void tcs_put_scene(tcs_request *request) {
  if (tcs_session_of(request)) tcs_read_body(request, "", put_scene);
}

void tcs_patch_scene(tcs_request *request) {
  if (tcs_session_of(request)) tcs_read_body(request, "", patch_scene);
}

/* --- WebSocket -------------------------------------------------------------------------------------- */

/* The request lives until the upgraded socket closes. The session may have ended since the reply. */
static void on_upgrade(void *user, struct MHD_Connection *connection, void *context, const char *extra,
                       size_t extra_size, MHD_socket fd, struct MHD_UpgradeResponseHandle *handle) {
  const tcs_request *request = user;
  tcs_server *server = request->server;
  tcs_session *session = server->draining ? NULL : tcs_sessions_find(server->sessions, request->params[0]);
  const GByteArray *held = tcs_http_held(connection); /* the library was given none of these bytes: extra is empty */
  tcs_streams_open(tcs_http_streams(server->http), session, &request->caller, fd, handle, held);
  if (session) tcs_audit(server->access, &request->caller, "session.join", session->id, session->entry->id);
}

bool tcs_viewer_fits(tcs_request *request, const tcs_session *session) {
  const tcs_server *server = request->server;
  const int64_t viewers = server->ws_clients + server->mjpeg_clients;
  if (viewers < server->config->limits.clients || !session->watchers->len) return true;
  tcs_reply_problem(request, 503, "busy", "Busy", "too many viewers; try again later");
  tcs_reply_header(request, "Retry-After", "5");
  return false;
}

static bool handshake_ok(tcs_request *request, const tcs_session *session) {
  const char *key = tcs_header(request, "Sec-WebSocket-Key"), *version = tcs_header(request, "Sec-WebSocket-Version");
  if (strcmp(request->method, "GET") != 0 || !tcs_token_in(tcs_header(request, "Upgrade"), "websocket", true) ||
      !tcs_token_in(tcs_header(request, "Connection"), "upgrade", true)) {
    tcs_reply_problem(request, 426, "upgrade", "Upgrade required", "this is a WebSocket: connect with ws:// or wss://");
    tcs_reply_header(request, "Upgrade", "websocket");
  } else if (!version || strcmp(version, "13") != 0) {
    tcs_reply_problem(request, 426, "upgrade", "Upgrade required", "only WebSocket version 13 is supported");
    tcs_reply_header(request, "Upgrade", "websocket");
    tcs_reply_header(request, "Sec-WebSocket-Version", "13");
  } else if (!key || !tcs_websocket_key_valid(key)) {
    tcs_reply_problem(request, 400, "handshake", "Bad handshake", "Sec-WebSocket-Key: must be 16 bytes in base64");
  } else if (!tcs_token_in(tcs_header(request, "Sec-WebSocket-Protocol"), TCS_SUBPROTOCOL, false)) {
    tcs_reply_problem(request, 400, "handshake", "Bad handshake", "ask for the subprotocol " TCS_SUBPROTOCOL);
  } else {
    return tcs_viewer_fits(request, session);
  }
  return false;
}

void tcs_get_stream(tcs_request *request) {
  const tcs_session *session = tcs_session_of(request);
  if (!session || !handshake_ok(request, session)) return;
  struct MHD_Response *response = MHD_create_response_for_upgrade(on_upgrade, request);
  if (!response) {
    request->cut = true;
    return;
  }
  char *accept = tcs_websocket_accept(tcs_header(request, "Sec-WebSocket-Key"));
  tcs_reply_response(request, 101, response);
  tcs_reply_header(request, "Upgrade", "websocket");
  tcs_reply_header(request, "Sec-WebSocket-Accept", accept);
  tcs_reply_header(request, "Sec-WebSocket-Protocol", TCS_SUBPROTOCOL);
  g_free(accept);
}
