/* Volumes and meshes over HTTP: listed, loaded, uploaded and deleted alike; volumes can also be queried. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "server/access/audit.h"
#include "server/catalogue/beneath.h"
#include "server/catalogue/catalogue.h"
#include "server/catalogue/spool.h"
#include "server/http/work.h"
#include "server/session/sessions.h"

#define MAX_AVAILABLE 2000
#define MAX_BINS 65536

#define MOST_WALKS 64 /* limit on waiting walks */

typedef struct walk {
  tcs_work work;
  const char *folder;
  tcs_kind kind;
  GArray *known; /* of a list: rows of the entries that the caller may see */
  bool all;      /* also list the files that could be loaded */
  tc_volume *volume;
  int bins;
} walk;

static void free_walk(tcs_work *work) {
  if (((walk *)work)->known) tcs_rows_free(((walk *)work)->known);
  tc_volume_unref(((walk *)work)->volume);
}

static walk *new_walk(void (*run)(tcs_work *work)) {
  walk *w = g_new0(walk, 1);
  w->work.run = run;
  w->work.free = free_walk;
  return w;
}

/* The kind, from the request's path. */
static tcs_kind kind_of(const tcs_request *request) {
  return g_str_has_prefix(request->route->pattern, tcs_kind_paths[TCS_KIND_MESH]) ? TCS_KIND_MESH : TCS_KIND_VOLUME;
}

static tcs_entry *entry_of(tcs_request *request) {
  const char *id = request->params[0];
  const tcs_kind kind = kind_of(request);
  tcs_entry *entry =
      tcs_entry_visible(request, kind, id) ? tcs_catalogue_find(request->server->catalogue, kind, id) : NULL;
  if (entry) return entry;
  char *detail = g_strdup_printf("there is no such %s; GET %s lists them", tcs_kind_names[kind], tcs_kind_paths[kind]);
  tcs_reply_problem(request, 404, "not-found", "Not found", detail);
  g_free(detail);
  return NULL;
}

/* --- list ------------------------------------------------------------------------------------------ */

static cJSON *available(tcs_kind kind, const char *folder) {
  static const char *const demos[] = {"demo:head", "demo:head-labels", "demo:vessels", "demo:marschner-lobb",
                                      "demo:bucky"};
  cJSON *list = tcs_available(folder, kind == TCS_KIND_MESH, MAX_AVAILABLE);
  for (size_t i = 0; kind == TCS_KIND_VOLUME && i < G_N_ELEMENTS(demos); i++) {
    cJSON *demo = cJSON_CreateObject();
    cJSON_AddStringToObject(demo, "path", demos[i]);
    cJSON_AddItemToArray(list, demo);
  }
  return list;
}

static void run_list(tcs_work *work) {
  walk *w = (walk *)work;
  cJSON *json = cJSON_CreateObject();
  const char *name = strrchr(tcs_kind_paths[w->kind], '/') + 1;
  cJSON_AddItemToObject(json, name, tcs_rows_describe(w->known));
  cJSON_AddItemToObject(json, "available", w->all ? available(w->kind, w->folder) : cJSON_CreateArray());
  work->text = tcs_json_text(json);
}

static bool is_visible(const void *request, tcs_kind kind, const char *id) {
  return tcs_entry_visible(request, kind, id);
}

static cJSON *describe(const tcs_request *request, const tcs_entry *entry) {
  return tcs_catalogue_describe(request->server->catalogue, entry, is_visible, request);
}

/* A caller bound to one session sees that session's volumes and meshes only, and no files. */
void tcs_get_entries(tcs_request *request) {
  walk *w = new_walk(run_list);
  w->kind = kind_of(request);
  w->folder = request->server->config->data;
  w->known = tcs_catalogue_rows(request->server->catalogue, w->kind, is_visible, request);
  w->all = !request->caller.session[0];
  tcs_work_start(request, request->server->walk_worker, &w->work, MOST_WALKS);
}

/* --- load ------------------------------------------------------------------------------------------ */

static void audit(tcs_request *request, const tcs_entry *entry, const char *what) {
  char *event = g_strconcat(tcs_kind_names[entry->kind], ".", what, NULL);
  tcs_audit(request->server->access, &request->caller, event, NULL, entry->id);
  g_free(event);
}

static void reply_loading(tcs_request *request, tcs_entry *entry, const char *what) {
  g_strlcpy(entry->owner, request->caller.name, sizeof entry->owner);
  audit(request, entry, what);
  char *location = g_strconcat(tcs_kind_paths[entry->kind], "/", entry->id, NULL);
  tcs_reply_json(request, 202, describe(request, entry));
  tcs_reply_header(request, "Location", location);
  g_free(location);
}

static void reply_and_clear(tcs_request *request, GError *error) {
  tcs_reply_error(request, error);
  g_clear_error(&error);
}

/* Starts a load of `source`; if !found, *error is set already. */
static tcs_entry *load(tcs_request *request, const char *id, bool found, tcs_source_file *source, GError **error) {
  tcs_catalogue *catalogue = request->server->catalogue;
  char *client = tcs_peer_name(request);
  if (found) g_strlcpy(source->client, client, sizeof source->client);
  g_free(client);
  return found ? tcs_catalogue_load(catalogue, kind_of(request), id, source, error) : NULL;
}

/* Loads another volume from the file of `of`, whose path the client may not know. */
static void post_another(tcs_request *request, const cJSON *body, const char *id, const char *of) {
  GError *error = NULL;
  tcs_source_file source;
  const cJSON *number = cJSON_GetObjectItemCaseSensitive(body, "volume");
  const tcs_entry *first = tcs_resident(request, of, "/of");
  if (!first) return;
  char root[TCS_ID_SIZE];
  g_strlcpy(root, first->of[0] ? first->of : first->id, sizeof root);
  const int part = cJSON_IsNumber(number) && number->valuedouble == number->valueint ? number->valueint : 0;
  tcs_entry *entry = load(request, id, tcs_catalogue_another(first, part, &source, &error), &source, &error);
  if (entry) {
    g_strlcpy(entry->of, root, sizeof entry->of);
    reply_loading(request, entry, "load");
  } else {
    reply_and_clear(request, error);
  }
}

static void post_entry(tcs_request *request, cJSON *body, const tcp_lists *lists) {
  const bool volume = kind_of(request) == TCS_KIND_VOLUME;
  static const char *const names[] = {"id", "path", NULL}, *const volume_names[] = {"id", "path", "of", "volume", NULL};
  const char *id, *path, *of = NULL;
  if (!tcs_members_known(request, body, volume ? volume_names : names) ||
      !tcs_member_string(request, body, "id", true, &id) ||
      (volume && !tcs_member_string(request, body, "of", false, &of)) ||
      !tcs_member_string(request, body, "path", !of, &path))
    return;
  if (of) {
    post_another(request, body, id, of);
    return;
  }
  GError *error = NULL;
  tcs_source_file source;
  tcs_catalogue *catalogue = request->server->catalogue;
  char *client = tcs_peer_name(request);
  const bool found = tcs_catalogue_may_load(catalogue, kind_of(request), id, client, &error) &&
                     tcs_catalogue_resolve(catalogue, kind_of(request), path, &source, &error);
  g_free(client);
  tcs_entry *entry = load(request, id, found, &source, &error);
  if (entry)
    reply_loading(request, entry, "load");
  else
    reply_and_clear(request, error);
}

void tcs_post_entry(tcs_request *request) { tcs_read_body(request, NULL, post_entry); }

/* The query's spacing=X,Y,Z for uploaded pictures, or NULL. */
static const char *spacing_of(const tcs_request *request) {
  return kind_of(request) == TCS_KIND_VOLUME ? tcs_query(request, "spacing") : NULL;
}

bool tcs_put_allowed(const tcs_request *request, const char *client, GError **error) {
  const char *spacing = spacing_of(request);
  if (spacing && spacing[strspn(spacing, "0123456789.,eE+-")]) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "spacing: give X,Y,Z in mm");
    return false;
  }
  return tcs_catalogue_may_load(request->server->catalogue, kind_of(request), request->params[0], client, error);
}

void tcs_put_entry(tcs_request *request) { tcs_upload_end(request); }

void tcs_put_entry_done(tcs_request *request, struct tcs_spooled *file) {
  GError *error = NULL;
  if (request->server->draining) {
    tcs_spooled_free(file);
    tcs_reply_draining(request);
    return;
  }
  const char *spacing = spacing_of(request);
  tcs_source_file source = {.path = g_strconcat(file->path, spacing ? "#spacing=" : NULL, spacing, NULL),
                            .name = "the upload",
                            .upload = file};
  memcpy(source.client, file->client, sizeof source.client);
  tcs_spooled_complete(file);
  tcs_entry *entry =
      tcs_catalogue_load(request->server->catalogue, kind_of(request), request->params[0], &source, &error);
  if (entry)
    reply_loading(request, entry, "upload");
  else
    reply_and_clear(request, error);
}

void tcs_get_entry(tcs_request *request) {
  const tcs_entry *entry = entry_of(request);
  if (!entry) return;
  cJSON *json = describe(request, entry);
  if (entry->volume) tcs_describe_labels(json, entry->volume);
  tcs_reply_json(request, 200, json);
}

void tcs_delete_entry(tcs_request *request) {
  tcs_entry *entry = entry_of(request);
  if (!entry) return;
  const char *force = tcs_query(request, "force");
  const bool forced = force && strcmp(force, "true") == 0;
  if (!tcs_caller_owns(&request->caller, entry->owner) || (forced && request->caller.role < TCS_ROLE_ADMIN)) {
    tcs_reply_problem(request, 403, "forbidden", "Not allowed",
                      "only its owner or the role admin may delete it, and only the role admin with force");
    return;
  }
  if (entry->users > 0 && !forced) {
    tcs_reply_problem(request, 409, "conflict", "In use", "sessions show it; end them or add ?force=true");
    return;
  }
  audit(request, entry, "delete");
  tcs_sessions_end_of(request->server->sessions, entry);
  tcs_catalogue_remove(request->server->catalogue, entry);
  tcs_reply_empty(request, 204);
}

/* --- look into it ---------------------------------------------------------------------------------- */

static void run_histogram(tcs_work *work) {
  walk *w = (walk *)work;
  uint64_t *counts = g_new(uint64_t, (gsize)w->bins);
  double *edges = g_new(double, (gsize)w->bins + 1);
  tc_volume_histogram(w->volume, w->bins, counts, edges);
  cJSON *json = cJSON_CreateObject();
  cJSON_AddItemToObject(json, "edges", cJSON_CreateDoubleArray(edges, w->bins + 1));
  double *numbers = edges; /* one more number than values */
  for (int i = 0; i < w->bins; i++) numbers[i] = (double)counts[i];
  cJSON_AddItemToObject(json, "counts", cJSON_CreateDoubleArray(numbers, w->bins));
  work->text = tcs_json_text(json);
  g_free(edges);
  g_free(counts);
}

void tcs_get_histogram(tcs_request *request) {
  int bins = 256;
  const tcs_entry *entry = tcs_resident(request, request->params[0], NULL);
  if (!entry || !tcs_query_int(request, "bins", 1, MAX_BINS, &bins)) return;
  walk *w = new_walk(run_histogram);
  w->volume = tc_volume_ref(entry->volume);
  w->bins = bins;
  tcs_work_start(request, request->server->walk_worker, &w->work, MOST_WALKS);
}

static bool parse_position(const char *text, double position[3]) {
  for (int i = 0; i < 3; i++) {
    char *end;
    position[i] = g_ascii_strtod(text, &end);
    if (end == text || !isfinite(position[i]) || *end != (i < 2 ? ',' : 0)) return false;
    text = end + 1;
  }
  return true;
}

void tcs_get_value(tcs_request *request) {
  const tcs_entry *entry = tcs_resident(request, request->params[0], NULL);
  if (!entry) return;
  const char *at = tcs_query(request, "at");
  double position[3], index[3], value;
  if (!at || !parse_position(at, position)) {
    tcs_reply_problem(request, 422, "invalid", "Invalid value", "query at: give x,y,z in LPS mm, as in at=0,-12.5,40");
    return;
  }
  cJSON *json = cJSON_CreateObject();
  cJSON_AddItemToObject(json, "at", cJSON_CreateDoubleArray(position, 3));
  tc_volume_lps_to_index(entry->volume, position, index);
  if (tc_volume_value_at(entry->volume, index, &value))
    cJSON_AddNumberToObject(json, "value", value);
  else
    cJSON_AddNullToObject(json, "value");
  tcs_reply_json(request, 200, json);
}
