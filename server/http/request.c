/* Requests and replies. */
#include <string.h>

#include "protocol/protocol.h"
#include "server/access/access.h"
#include "server/catalogue/catalogue.h"
#include "server/http/http.h"
#include "server/session/sessions.h"
#include "server/ws/handshake.h"

/* --- replies --------------------------------------------------------------------------------------- */

void tcs_reply_header(tcs_request *request, const char *name, const char *value) {
  if (request->reply) MHD_add_response_header(request->reply, name, value);
}

void tcs_reply_text(tcs_request *request, int status, const char *type, char *text) {
  struct MHD_Response *response = MHD_create_response_from_buffer(strlen(text), text, MHD_RESPMEM_MUST_FREE);
  if (!response) free(text);
  if (response) MHD_add_response_header(response, "Content-Type", type);
  tcs_reply_response(request, status, response);
  request->problem = response ? text : NULL;
}

static void reply_document(tcs_request *request, int status, const char *type, cJSON *json) {
  char *text = cJSON_PrintUnformatted(json);
  cJSON_Delete(json);
  tcs_reply_text(request, status, type, text ? text : strdup("{}"));
}

void tcs_reply_json(tcs_request *request, int status, cJSON *json) {
  reply_document(request, status, "application/json", json);
}

void tcs_reply_error(tcs_request *request, const GError *error) {
  const int status = tcp_problem_status(error);
  reply_document(request, status, "application/problem+json", tcp_problem(error));
  if (status == 503) tcs_reply_header(request, "Retry-After", "1");
}

void tcs_reply_error_in(tcs_request *request, const GError *error, const char *prefix) {
  const char *pointer = tc_error_pointer(error);
  if (!pointer || error->domain != TC_ERROR) {
    tcs_reply_error(request, error);
    return;
  }
  GError *inside = NULL;
  char *whole = g_strconcat(prefix, pointer, NULL);
  tc_set_error(&inside, (tc_error_code)error->code, whole, "%s", error->message);
  tcs_reply_error(request, inside);
  g_free(whole);
  g_clear_error(&inside);
}

void tcs_reply_problem(tcs_request *request, int status, const char *code, const char *title, const char *detail) {
  reply_document(request, status, "application/problem+json", tcp_problem_named(status, code, title, detail));
}

void tcs_reply_draining(tcs_request *request) {
  tcs_reply_problem(request, 503, "draining", "Shutting down", "the server is shutting down; try another or wait");
  tcs_reply_header(request, "Retry-After", "2");
}

static void release_bytes(void *bytes) { g_bytes_unref(bytes); }

void tcs_reply_bytes(tcs_request *request, int status, const char *type, GBytes *bytes) {
  gsize size;
  const void *data = g_bytes_get_data(bytes, &size);
  struct MHD_Response *response =
      MHD_create_response_from_buffer_with_free_callback_cls(size, (void *)(uintptr_t)data, release_bytes, bytes);
  if (response)
    MHD_add_response_header(response, "Content-Type", type);
  else
    g_bytes_unref(bytes);
  tcs_reply_response(request, status, response);
}

void tcs_reply_empty(tcs_request *request, int status) {
  tcs_reply_response(request, status, MHD_create_response_from_buffer(0, NULL, MHD_RESPMEM_PERSISTENT));
}

/* Joins all lines of a header in order; NULL: none. */
typedef struct lines {
  const char *name;
  GString *text;
} lines;

static enum MHD_Result add_line(void *user, enum MHD_ValueKind kind, const char *name, const char *value) {
  lines *l = user;
  if (g_ascii_strcasecmp(name, l->name) != 0) return MHD_YES;
  if (!l->text) l->text = g_string_new(NULL);
  g_string_append_printf(l->text, "%s%s", l->text->len ? "," : "", value ? value : "");
  return MHD_YES;
}

static char *all_lines(const tcs_request *request, const char *name) {
  lines l = {name, NULL};
  MHD_get_connection_values(request->connection, MHD_HEADER_KIND, add_line, &l);
  return l.text ? g_string_free(l.text, FALSE) : NULL;
}

char *tcs_peer_name(const tcs_request *request) {
  const tcs_proxies *proxies = request->server->access->proxies;
  const union MHD_ConnectionInfo *info =
      MHD_get_connection_info(request->connection, MHD_CONNECTION_INFO_CLIENT_ADDRESS);
  const struct sockaddr *from = info ? info->client_addr : NULL;
  const bool proxied = tcs_proxies_trust(proxies, from);
  char text[INET6_ADDRSTRLEN];
  char *forwarded = proxied ? all_lines(request, "Forwarded") : NULL;
  char *x_forwarded_for = proxied ? all_lines(request, "X-Forwarded-For") : NULL;
  tcs_proxies_peer(proxies, from, forwarded, x_forwarded_for, text);
  g_free(forwarded);
  g_free(x_forwarded_for);
  return g_strconcat(text, " ", request->caller.name, NULL);
}

/* --- reading --------------------------------------------------------------------------------------- */

const char *tcs_header(const tcs_request *request, const char *name) {
  return MHD_lookup_connection_value(request->connection, MHD_HEADER_KIND, name);
}

const char *tcs_query(const tcs_request *request, const char *name) {
  return MHD_lookup_connection_value(request->connection, MHD_GET_ARGUMENT_KIND, name);
}

bool tcs_query_int(tcs_request *request, const char *name, int least, int most, int *value) {
  const char *text = tcs_query(request, name);
  if (!text) return true;
  char *end;
  const gint64 number = g_ascii_strtoll(text, &end, 10);
  if (end != text && !*end && number >= least && number <= most) {
    *value = (int)number;
    return true;
  }
  char detail[128];
  g_snprintf(detail, sizeof detail, "query %s: give a whole number from %d to %d", name, least, most);
  tcs_reply_problem(request, 422, "invalid", "Invalid value", detail);
  return false;
}

cJSON *tcs_body_json(tcs_request *request) {
  GError *error = NULL;
  const char *text = request->body->data ? (const char *)request->body->data : ""; /* empty: no buffer yet */
  cJSON *json = tcp_json_parse(text, request->body->len, &error);
  if (!json) {
    tcs_reply_error(request, error);
    g_clear_error(&error);
  }
  return json;
}

struct tcs_entry *tcs_resident(tcs_request *request, const char *id, const char *member) {
  GError *error = NULL;
  tcs_entry *entry = NULL;
  if (tcs_entry_visible(request, TCS_KIND_VOLUME, id))
    entry = tcs_catalogue_resident(request->server->catalogue, TCS_KIND_VOLUME, id, member, &error);
  else
    tc_set_error(&error, TC_ERROR_NOT_FOUND, member, "there is no such volume; GET /v1/volumes lists them");
  if (entry) return entry;
  tcs_reply_error(request, error);
  const tcs_entry *other = tcs_catalogue_find(request->server->catalogue, TCS_KIND_VOLUME, id);
  if (other && other->state == TCS_LOADING) tcs_reply_header(request, "Retry-After", "1");
  g_clear_error(&error);
  return NULL;
}

tcs_session *tcs_session_of(tcs_request *request) {
  tcs_session *session = tcs_sessions_find(request->server->sessions, request->params[0]);
  if (session && !tcs_caller_sees(&request->caller, session->id, session->owner)) session = NULL;
  if (session)
    session->used_us = g_get_monotonic_time();
  else
    tcs_reply_problem(request, 404, "not-found", "Not found", "there is no such session; it may have ended");
  return session;
}

tcs_session *tcs_own_session(tcs_request *request) {
  tcs_session *session = tcs_session_of(request);
  if (!session || tcs_caller_owns(&request->caller, session->owner)) return session;
  tcs_reply_problem(request, 403, "forbidden", "Not allowed",
                    "only the session's owner or the role admin may do this");
  return NULL;
}

bool tcs_session_visible(const tcs_request *request, const char *id) {
  const tcs_session *session = tcs_sessions_find(request->server->sessions, id);
  return session && tcs_caller_sees(&request->caller, session->id, session->owner);
}

bool tcs_entry_visible(const tcs_request *request, tcs_kind kind, const char *id) {
  const char *only = request->caller.session;
  if (!only[0]) return true;
  const tcs_session *session = tcs_sessions_find(request->server->sessions, only);
  const tcs_entry *entry = tcs_catalogue_find(request->server->catalogue, kind, id);
  return session && entry && tcs_session_shows(session, entry);
}

static void refuse_member(tcs_request *request, const char *name, const char *what) {
  GError *error = NULL;
  char *pointer = name ? g_strconcat("/", name, NULL) : g_strdup("");
  tc_set_error(&error, TC_ERROR_INVALID, pointer, "%s%s%s", name ? name : "the body", ": ", what);
  tcs_reply_error(request, error);
  g_clear_error(&error);
  g_free(pointer);
}

bool tcs_members_known(tcs_request *request, const cJSON *body, const char *const *names) {
  if (!cJSON_IsObject(body)) {
    refuse_member(request, NULL, "an object expected");
    return false;
  }
  for (const cJSON *item = body->child; item; item = item->next) {
    bool known = false;
    for (const char *const *name = names; *name && !known; name++) known = strcmp(*name, item->string) == 0;
    if (known) continue;
    refuse_member(request, item->string, "there is no such member");
    return false;
  }
  return true;
}

bool tcs_member_string(tcs_request *request, const cJSON *body, const char *name, bool required, const char **value) {
  const cJSON *item = cJSON_GetObjectItemCaseSensitive(body, name);
  *value = cJSON_GetStringValue(item);
  if (*value || (!item && !required)) return true;
  refuse_member(request, name, item ? "a string expected" : "is missing");
  return false;
}

bool tcs_etag_listed(const char *header, const char *etag) {
  if (!header) return false;
  return tcs_token_in(header, "*", false) || tcs_token_in(header, etag, false);
}

static bool type_is(const char *header, const char *type) {
  const size_t length = strlen(type);
  if (!header || g_ascii_strncasecmp(header, type, length) != 0) return false;
  return header[length] == 0 || header[length] == ';' || header[length] == ' ';
}

bool tcs_body_acceptable(tcs_request *request) {
  const tcs_limits *limits = &request->server->config->limits;
  const tcs_body body = request->route->body;
  const char *type = tcs_header(request, "Content-Type"), *length = tcs_header(request, "Content-Length");
  if (body == TCS_BODY_NONE) return true;
  const char *coding = tcs_header(request, "Content-Encoding");
  if (coding && g_ascii_strcasecmp(coding, "identity") != 0) {
    tcs_reply_problem(request, 415, "content-type", "Unsupported media type", "send the body without Content-Encoding");
    tcs_reply_header(request, "Accept-Encoding", "identity");
    return false;
  }
  const bool json = type_is(type, "application/json");
  if ((body == TCS_BODY_JSON && !json) ||
      (body == TCS_BODY_PATCH && !json && !type_is(type, "application/merge-patch+json"))) {
    tcs_reply_problem(request, 415, "content-type", "Unsupported media type",
                      body == TCS_BODY_JSON ? "send application/json"
                                            : "send application/merge-patch+json or application/json");
    if (body == TCS_BODY_PATCH)
      tcs_reply_header(request, "Accept-Patch", "application/merge-patch+json, application/json");
    return false;
  }
  const int64_t most = body == TCS_BODY_FILE ? limits->upload_bytes : limits->body_bytes;
  if (length && g_ascii_strtoull(length, NULL, 10) > (guint64)most) {
    tcs_reply_problem(request, 413, "limit", "Too large", "the body is over the limit, which /v1/about shows");
    return false;
  }
  return true;
}
