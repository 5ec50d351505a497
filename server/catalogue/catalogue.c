#include "server/catalogue/catalogue.h"

#include <string.h>

#include "server/catalogue/beneath.h"
#include "server/catalogue/own.h"
#include "server/catalogue/spool.h"
#include "server/config/config.h"

/* Entries reported to viewers per call; the next call reports the rest. */
#define MOST_TOLD 32

const char *const tcs_kind_names[TCS_KIND_COUNT] = {"volume", "mesh"};
const char *const tcs_kind_paths[TCS_KIND_COUNT] = {"/v1/volumes", "/v1/meshes"};

static const char *const state_names[TCS_VOLUME_STATE_COUNT] = {"loading", "resident", "failed"};

static void free_entry(void *item) {
  tcs_entry *entry = item;
  if (entry->load) tcs_load_leave(entry->load);
  tcs_preparation_end(entry);
  tcs_series_unref(entry->series);
  tc_volume_unref(entry->volume);
  tc_volume_unref(entry->body);
  tc_mesh_free(entry->mesh);
  g_clear_pointer(&entry->thumbnail, g_bytes_unref);
  tc_scene_clear(&entry->defaults);
  g_free(entry->reason);
  g_free(entry);
}

static guint hash_entry(const void *item) {
  const tcs_entry *entry = item;
  return g_str_hash(entry->id) + (guint)entry->kind;
}

static gboolean same_entry(const void *a, const void *b) {
  const tcs_entry *x = a, *y = b;
  return x->kind == y->kind && strcmp(x->id, y->id) == 0;
}

tcs_catalogue *tcs_catalogue_new(tcs_server *server) {
  tcs_catalogue *catalogue = g_new0(tcs_catalogue, 1);
  catalogue->server = server;
  tcs_budget_when_asked(server->budget, tcs_room_give, catalogue);
  g_queue_init(&catalogue->loads);
  g_queue_init(&catalogue->failed);
  catalogue->entries = g_hash_table_new_full(hash_entry, same_entry, free_entry, NULL);
  return catalogue;
}

void tcs_catalogue_free(tcs_catalogue *catalogue) {
  if (!catalogue) return;
  g_hash_table_destroy(catalogue->entries);
  g_free(catalogue);
}

tcs_entry *tcs_catalogue_find(tcs_catalogue *catalogue, tcs_kind kind, const char *id) {
  static tcs_entry wanted; /* static: a lookup key */
  wanted.kind = kind;
  return g_strlcpy(wanted.id, id, sizeof wanted.id) < sizeof wanted.id
             ? g_hash_table_lookup(catalogue->entries, &wanted)
             : NULL;
}

tcs_entry *tcs_catalogue_resident(tcs_catalogue *catalogue, tcs_kind kind, const char *id, const char *member,
                                  GError **error) {
  tcs_entry *entry = tcs_catalogue_find(catalogue, kind, id);
  const char *noun = tcs_kind_names[kind];
  if (entry && entry->state == TCS_RESIDENT) {
    entry->used_us = g_get_monotonic_time();
    return entry;
  }
  if (!entry)
    tc_set_error(error, TC_ERROR_NOT_FOUND, member, "there is no such %s; GET %s lists them", noun,
                 tcs_kind_paths[kind]);
  else if (entry->state == TCS_LOADING)
    tc_set_error(error, TC_ERROR_CONFLICT, member, "the %s is still loading; ask again when its state is resident",
                 noun);
  else
    tc_set_error(error, TC_ERROR_CONFLICT, member, "the %s could not be loaded: %s", noun, entry->reason);
  return NULL;
}

static void forget(tcs_catalogue *catalogue, tcs_entry *entry) {
  if (entry->failed_link.data) g_queue_unlink(&catalogue->failed, &entry->failed_link);
  g_hash_table_remove(catalogue->entries, entry);
}

/* The oldest failed entries: those over the limit, and those past their time. */
static void forget_failed(tcs_catalogue *catalogue, int64_t now_us) {
  const tcs_limits *limits = &catalogue->server->config->limits;
  for (tcs_entry *oldest; (oldest = g_queue_peek_head(&catalogue->failed));) {
    if (catalogue->failed.length <= limits->failed_entries &&
        now_us - oldest->used_us < limits->failed_seconds * 1000000)
      return;
    forget(catalogue, oldest);
  }
}

bool tcs_catalogue_may_load(tcs_catalogue *catalogue, tcs_kind kind, const char *id, const char *client,
                            GError **error) {
  if (!tcs_id_valid(id)) {
    tc_set_error(error, TC_ERROR_INVALID, "/id", "a %s id is 1 to 64 of letters, digits, '.', '_', '-', not dots alone",
                 tcs_kind_names[kind]);
    return false;
  }
  const tcs_entry *entry = tcs_catalogue_find(catalogue, kind, id);
  if (entry && entry->state != TCS_FAILED) {
    tc_set_error(error, TC_ERROR_CONFLICT, "/id", "there is a %s of this id already; delete it first",
                 tcs_kind_names[kind]);
    return false;
  }
  if (!tcs_room_possible(catalogue, tcs_room_of(1))) {
    tcs_budget_refuse(catalogue->server->budget, TCS_MEMORY_LOADS, tcs_room_of(1), error);
    return false;
  }
  return tcs_loads_allow(catalogue, client, error);
}

tcs_entry *tcs_catalogue_load(tcs_catalogue *catalogue, tcs_kind kind, const char *id, tcs_source_file *source,
                              GError **error) {
  forget_failed(catalogue, g_get_monotonic_time()); /* thousands may fail between two ticks */
  if (!tcs_catalogue_may_load(catalogue, kind, id, source->operators ? NULL : source->client, error)) {
    tcs_spooled_free(source->upload);
    tcs_series_unref(source->series);
    g_free(source->path);
    return NULL;
  }
  tcs_entry *entry = tcs_catalogue_find(catalogue, kind, id);
  if (entry) forget(catalogue, entry); /* a failed entry */
  entry = g_new0(tcs_entry, 1);
  entry->kind = kind;
  g_strlcpy(entry->id, id, sizeof entry->id);
  entry->operators = source->operators;
  entry->series = source->series ? tcs_series_ref(source->series) : NULL;
  entry->part = source->part;
  g_hash_table_add(catalogue->entries, entry);
  tcs_load_begin(catalogue, entry, source);
  return entry;
}

void tcs_catalogue_remove(tcs_catalogue *catalogue, tcs_entry *entry) {
  tcs_entry_release(catalogue, entry);
  forget(catalogue, entry);
  tcs_loads_pump(catalogue);
}

/* --- failed entries --------------------------------------------------------------------------------- */

void tcs_entry_fail(tcs_catalogue *catalogue, tcs_entry *entry, char *reason) {
  entry->state = TCS_FAILED;
  entry->used_us = g_get_monotonic_time();
  g_free(entry->reason);
  entry->reason = reason;
  if (entry->operators) return;
  entry->failed_link.data = entry;
  g_queue_push_tail_link(&catalogue->failed, &entry->failed_link);
}

void tcs_catalogue_tick(tcs_catalogue *catalogue, int64_t now_us) {
  forget_failed(catalogue, now_us);
  tcs_loads_pump(catalogue);
}

void tcs_catalogue_cancel_all(tcs_catalogue *catalogue) {
  catalogue->ended = true;
  GHashTableIter iterator;
  void *value;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (g_hash_table_iter_next(&iterator, &value, NULL)) {
    tcs_entry *entry = value;
    if (entry->load) atomic_store(&entry->load->cancel, true);
    tcs_preparation_end(entry);
  }
}

bool tcs_catalogue_starting(tcs_catalogue *catalogue) {
  const GPtrArray *volumes = catalogue->server->config->volumes;
  for (guint i = 0; i < volumes->len; i++) {
    const tcs_named_path *named = g_ptr_array_index(volumes, i);
    const tcs_entry *entry = tcs_catalogue_find(catalogue, TCS_KIND_VOLUME, named->id);
    if (entry && entry->state == TCS_LOADING) return true;
  }
  return false;
}

bool tcs_catalogue_another(const tcs_entry *entry, int part, tcs_source_file *source, GError **error) {
  tcs_series *series = entry->series;
  if (!series || part < 1 || part > series->frames) {
    tc_set_error(error, TC_ERROR_INVALID, "/volume", "volume: the file holds %d", series ? series->frames : 1);
    return false;
  }
  *source = (tcs_source_file){.path = g_strdup_printf("%s#volume=%d", series->path, part),
                              .name = entry->id,
                              .series = tcs_series_ref(series),
                              .part = part};
  return true;
}

bool tcs_catalogue_resolve(tcs_catalogue *catalogue, tcs_kind kind, const char *path, tcs_source_file *source,
                           GError **error) {
  const char *data = catalogue->server->config->data;
  *source = (tcs_source_file){.name = path};
  if (kind == TCS_KIND_VOLUME && g_str_has_prefix(path, "demo:")) {
    source->path = g_strdup(path);
    return true;
  }
  if (!data) {
    tc_set_error(error, TC_ERROR_NOT_FOUND, "/path", "there is no data folder; start the server with --data DIR");
    return false;
  }
  source->path = tcs_beneath(data, path, error);
  return source->path != NULL;
}

/* A snapshot of an entry, described on another thread. */
typedef struct row {
  char id[TCS_ID_SIZE];
  tcs_volume_state state;
  int permille; /* of the import; -1: not loading */
  int users;
  char of[TCS_ID_SIZE];
  char *reason;      /* or NULL */
  tc_volume *volume; /* or NULL */
  tc_fit fit;        /* of a volume */
  bool has_body;
  tc_mesh *mesh; /* or NULL */
  tc_mesh_file file;
  tc_mesh_measures measures;
} row;

static row row_of(const tcs_entry *entry) {
  row r = {.state = entry->state,
           .permille = entry->load ? atomic_load(&entry->load->permille) : -1,
           .users = entry->users,
           .reason = entry->reason,
           .volume = entry->volume,
           .fit = entry->fit,
           .has_body = entry->body != NULL,
           .mesh = entry->mesh,
           .file = entry->file,
           .measures = entry->measures};
  memcpy(r.id, entry->id, sizeof r.id);
  memcpy(r.of, entry->of, sizeof r.of);
  return r;
}

static cJSON *describe(const row *r) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "id", r->id);
  cJSON_AddStringToObject(json, "state", state_names[r->state]);
  if (r->of[0]) cJSON_AddStringToObject(json, "of", r->of);
  if (r->permille >= 0) cJSON_AddNumberToObject(json, "fraction", r->permille / 1000.0);
  if (r->reason) cJSON_AddStringToObject(json, "reason", r->reason);
  if (r->volume) tcs_volume_describe(json, r->volume, &r->fit, r->has_body);
  if (r->mesh) tcs_mesh_describe(json, r->mesh, &r->file, &r->measures);
  cJSON_AddNumberToObject(json, "sessions", r->users);
  return json;
}

static void add_volumes(tcs_catalogue *catalogue, const tcs_series *series, tcs_entry_wanted *wanted, const void *user,
                        cJSON *json) {
  cJSON *list = cJSON_AddArrayToObject(json, "volumes");
  GHashTableIter iterator;
  void *value;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (g_hash_table_iter_next(&iterator, &value, NULL)) {
    const tcs_entry *entry = value;
    if (entry->series != series || !wanted(user, entry->kind, entry->id)) continue;
    cJSON *item = cJSON_CreateObject();
    cJSON_AddStringToObject(item, "id", entry->id);
    cJSON_AddNumberToObject(item, "volume", entry->part);
    cJSON_AddStringToObject(item, "state", state_names[entry->state]);
    cJSON_AddItemToArray(list, item);
  }
}

cJSON *tcs_catalogue_describe(tcs_catalogue *catalogue, const tcs_entry *entry, tcs_entry_wanted *wanted,
                              const void *user) {
  const row r = row_of(entry);
  cJSON *json = describe(&r);
  if (entry->series) add_volumes(catalogue, entry->series, wanted, user, json);
  return json;
}

GArray *tcs_catalogue_rows(tcs_catalogue *catalogue, tcs_kind kind, tcs_entry_wanted *wanted, const void *user) {
  GArray *rows = g_array_new(FALSE, FALSE, sizeof(row));
  GHashTableIter iterator;
  void *entry;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (g_hash_table_iter_next(&iterator, &entry, NULL)) {
    row r = row_of(entry);
    if (((tcs_entry *)entry)->kind != kind || (wanted && !wanted(user, kind, r.id))) continue;
    r.reason = g_strdup(r.reason);
    if (r.volume) tc_volume_ref(r.volume);
    if (r.mesh) tc_mesh_ref(r.mesh);
    g_array_append_val(rows, r);
  }
  return rows;
}

void tcs_rows_free(GArray *rows) {
  for (guint i = 0; i < rows->len; i++) {
    const row *r = &g_array_index(rows, row, i);
    g_free(r->reason);
    tc_volume_unref(r->volume);
    tc_mesh_free(r->mesh);
  }
  g_array_unref(rows);
}

static int by_id(const void *a, const void *b) { return strcmp(((const row *)a)->id, ((const row *)b)->id); }

cJSON *tcs_rows_describe(GArray *rows) {
  cJSON *list = cJSON_CreateArray();
  g_array_sort(rows, by_id);
  for (guint i = 0; i < rows->len; i++) cJSON_AddItemToArray(list, describe(&g_array_index(rows, row, i)));
  return list;
}

void tcs_catalogue_gauges(tcs_catalogue *catalogue, tcs_gauges *gauges) {
  GHashTableIter iterator;
  void *value;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (g_hash_table_iter_next(&iterator, &value, NULL)) {
    const tcs_entry *entry = value;
    const bool mesh = entry->kind == TCS_KIND_MESH, resident = entry->state == TCS_RESIDENT;
    gauges->meshes_resident += mesh && resident;
    gauges->volumes_resident += !mesh && resident;
    gauges->volumes_loading += !mesh && entry->state == TCS_LOADING;
    if (!mesh && resident) gauges->volume_bytes += tcs_entry_bytes(entry);
  }
  tcs_budget *budget = catalogue->server->budget;
  gauges->memory_total = tcs_budget_total(budget);
  G_STATIC_ASSERT(TCS_MEMORY_KIND_COUNT <= TCS_METRICS_MEMORY);
  for (int kind = 0; kind < TCS_MEMORY_KIND_COUNT; kind++) {
    gauges->memory[kind].kind = tcs_memory_kind_name((tcs_memory_kind)kind);
    gauges->memory[kind].bytes = tcs_budget_used(budget, (tcs_memory_kind)kind);
  }
}

/* The report on an entry, if its state or progress changed since the last one; else false. */
static bool tell_of(tcs_entry *entry, char *text, size_t size) {
  const int permille = entry->load ? atomic_load(&entry->load->permille) : 1000;
  if (entry->state == entry->told && (!entry->load || permille == entry->load->told)) return false;
  entry->told = entry->state;
  if (entry->load) entry->load->told = permille;
  g_snprintf(text, size, "{\"type\":\"%s\",\"id\":\"%s\",\"state\":\"%s\",\"fraction\":%d.%03d}",
             tcs_kind_names[entry->kind], entry->id, state_names[entry->state], permille / 1000, permille % 1000);
  return true;
}

void tcs_catalogue_report(tcs_catalogue *catalogue, void (*tell)(void *user, const char *json), void *user) {
  GHashTableIter iterator;
  void *value;
  char text[160];
  int left = MOST_TOLD;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (left > 0 && g_hash_table_iter_next(&iterator, &value, NULL)) {
    if (!tell_of(value, text, sizeof text)) continue;
    tell(user, text);
    left--;
  }
}
