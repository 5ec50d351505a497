/* The service's own data: health, metrics, limits, contract, presets, and the browser client. */
#include <string.h>

#include "renderer/base/embedded.h"
#include "server/catalogue/catalogue.h"
#include "server/http/work.h"
#include "server/loop/worker.h"
#include "server/session/sessions.h"
#include "server/ws/handshake.h"

static void reply_status(tcs_request *request, int status, const char *text) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "status", text);
  tcs_reply_json(request, status, json);
}

void tcs_get_healthz(tcs_request *request) { reply_status(request, 200, "ok"); }

void tcs_get_readyz(tcs_request *request) {
  tcs_server *server = request->server;
  const char *why = server->draining                            ? "the server is shutting down"
                    : tcs_catalogue_starting(server->catalogue) ? "volumes are being loaded"
                                                                : NULL;
  if (!why) {
    reply_status(request, 200, "ready");
    return;
  }
  tcs_reply_problem(request, 503, "busy", "Not ready", why);
  tcs_reply_header(request, "Retry-After", "1");
}

void tcs_get_metrics(tcs_request *request) {
  tcs_server *server = request->server;
  tcs_gauges gauges = {.ws_clients = server->ws_clients,
                       .mjpeg_clients = server->mjpeg_clients,
                       .sessions = tcs_sessions_count(server->sessions),
                       .queued = tcs_scheduler_waiting(server->scheduler),
                       .probes = tcs_worker_waiting(server->probe_worker),
                       .walks = tcs_worker_waiting(server->walk_worker),
                       .texts = tcs_worker_waiting(server->text_worker)};
  tcs_catalogue_gauges(server->catalogue, &gauges);
  tcs_reply_text(request, 200, "text/plain; version=0.0.4; charset=utf-8",
                 tcs_metrics_write(server->metrics, &gauges, tcs_scheduler_about(server->scheduler)->backend));
}

static void add_text(cJSON *json, const char *name, const char *text) {
  cJSON_AddStringToObject(json, name, text ? text : "");
}

static cJSON *write_about(const tcs_server *server) {
  const tc_renderer_info *info = tcs_scheduler_about(server->scheduler);
  cJSON *json = cJSON_CreateObject();
  add_text(json, "name", "tomocast");
  add_text(json, "version", TC_VERSION);
  add_text(json, "backend", info->backend);
  add_text(json, "why", info->why);
  add_text(json, "device", info->device);
  add_text(json, "simd", info->isa);
  cJSON_AddNumberToObject(json, "threads", info->threads);
  cJSON *limits = cJSON_AddObjectToObject(json, "limits");
  size_t count;
  const tcs_limit_field *fields = tcs_limit_fields(&count);
  for (size_t i = 0; i < count; i++) {
    int64_t value;
    memcpy(&value, (const char *)&server->config->limits + fields[i].offset, sizeof value);
    cJSON_AddNumberToObject(limits, fields[i].json, (double)value);
  }
  cJSON_AddItemToObject(json, "unavailable", tcs_unavailable());
  return json;
}

GBytes *tcs_document_write(const tcs_server *server, tcs_document which) {
  cJSON *json = which == TCS_DOCUMENT_ABOUT          ? write_about(server)
                : which == TCS_DOCUMENT_OPENAPI      ? tcp_openapi(TC_VERSION)
                : which == TCS_DOCUMENT_SCENE_SCHEMA ? tcp_scene_schema()
                                                     : tcp_presets();
  char *text = tcs_json_text(json);
  return g_bytes_new_take(text, strlen(text));
}

static void reply_document(tcs_request *request, tcs_document which) {
  tcs_reply_bytes(request, 200, "application/json", g_bytes_ref(tcs_http_document(request->server->http, which)));
}

void tcs_get_about(tcs_request *request) { reply_document(request, TCS_DOCUMENT_ABOUT); }
void tcs_get_openapi(tcs_request *request) { reply_document(request, TCS_DOCUMENT_OPENAPI); }
void tcs_get_scene_schema(tcs_request *request) { reply_document(request, TCS_DOCUMENT_SCENE_SCHEMA); }
void tcs_get_presets(tcs_request *request) { reply_document(request, TCS_DOCUMENT_PRESETS); }

/* --- static files: from a table in the program, not from the file system ---------------------------- */

static const char *type_of(const char *name) {
  static const char *const types[][2] = {{".html", "text/html; charset=utf-8"},
                                         {".js", "text/javascript; charset=utf-8"},
                                         {".css", "text/css; charset=utf-8"},
                                         {".svg", "image/svg+xml"}};
  for (size_t i = 0; i < G_N_ELEMENTS(types); i++)
    if (g_str_has_suffix(name, types[i][0])) return types[i][1];
  return "application/octet-stream";
}

/* Whether `asked` is the name without the hash, such as "main.js" for "main.2fb19c8a2c64.js"; serves the current file.
 */
static bool is_plain_name(const char *asked, const char *name) {
  const char *dot = strchr(name, '.'), *end = strrchr(name, '.');
  const size_t stem = (size_t)(dot - name);
  return dot != end && strncmp(asked, name, stem) == 0 && strcmp(asked + stem, end) == 0;
}

static const struct tc_embedded_file *find_file(const char *asked, bool *kept_for_good) {
  for (const struct tc_embedded_file *file = tc_web_files; file->name; file++) {
    if (g_str_has_suffix(file->name, ".gz")) continue;
    const bool named = strcmp(file->name, asked) == 0;
    *kept_for_good = named && strchr(file->name, '.') != strrchr(file->name, '.');
    if (named || is_plain_name(asked, file->name)) return file;
  }
  return NULL;
}

/* The gzip variant of a file, made by deploy/bundle.cmake. */
static const struct tc_embedded_file *packed(const struct tc_embedded_file *file) {
  const size_t length = strlen(file->name);
  for (const struct tc_embedded_file *other = tc_web_files; other->name; other++)
    if (strncmp(other->name, file->name, length) == 0 && strcmp(other->name + length, ".gz") == 0) return other;
  return file;
}

static char *etag_of(const struct tc_embedded_file *file) {
  char *sum = g_compute_checksum_for_data(G_CHECKSUM_SHA256, file->bytes, file->size);
  char *etag = g_strdup_printf("\"%.16s\"", sum);
  g_free(sum);
  return etag;
}

static void reply_file(tcs_request *request, const struct tc_embedded_file *plain, bool kept_for_good) {
  const bool may_pack =
      tcs_token_in(tcs_header(request, "Accept-Encoding"), "gzip", true); /* a weight (q=) means no match: not packed */
  const struct tc_embedded_file *file = may_pack ? packed(plain) : plain;
  char *etag = etag_of(file);
  if (tcs_etag_listed(tcs_header(request, "If-None-Match"), etag)) {
    tcs_reply_empty(request, 304);
  } else {
    tcs_reply_response(
        request, 200,
        MHD_create_response_from_buffer(file->size, (void *)(uintptr_t)file->bytes, MHD_RESPMEM_PERSISTENT));
    tcs_reply_header(request, "Content-Type", type_of(plain->name));
    if (file != plain) tcs_reply_header(request, "Content-Encoding", "gzip");
  }
  tcs_reply_header(request, "ETag", etag);
  tcs_reply_header(request, "Vary", "Accept-Encoding");
  /* no-cache: may be stored, but must be revalidated (304) */
  tcs_reply_header(request, "Cache-Control", kept_for_good ? "public, max-age=31536000, immutable" : "no-cache");
  g_free(etag);
}

void tcs_get_static(tcs_request *request) {
  bool kept_for_good;
  const struct tc_embedded_file *file =
      find_file(request->params[0][0] ? request->params[0] : "index.html", &kept_for_good);
  if (file)
    reply_file(request, file, kept_for_good);
  else
    tcs_reply_problem(request, 404, "not-found", "Not found", "there is nothing at this path");
}
