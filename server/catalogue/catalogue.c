#include "server/catalogue/catalogue.h"

#include <string.h>
#include <unistd.h>

#include "server/catalogue/beneath.h"
#include "server/config/config.h"
#include "server/loop/worker.h"
#include "server/observe/log.h"
#include "server/schedule/scheduler.h"

struct tcs_catalogue {
  tcs_server *server;
  GHashTable *entries; /* id (inside the entry) -> tcs_entry */
  uint64_t resident_bytes;
};

struct tcs_load {
  tcs_task task;
  tcs_catalogue *catalogue;
  tcs_entry *entry; /* NULL: nobody wants it any more */
  tcs_source_file source;
  char *name;
  uint64_t max_bytes;
  atomic_bool cancel;
  atomic_int permille;
  int told; /* permille in the last report */
  int64_t began_us;
  tc_volume *volume;
  tc_scene defaults; /* that fit it; zeros without */
  GError *error;
};

static const char *const state_names[TCS_VOLUME_STATE_COUNT] = {"loading", "resident", "failed"};

static void free_entry(void *item) {
  tcs_entry *entry = item;
  if (entry->load) {
    atomic_store(&entry->load->cancel, true);
    entry->load->entry = NULL;
  }
  tc_volume_unref(entry->volume);
  tc_scene_clear(&entry->defaults);
  g_free(entry->reason);
  g_free(entry);
}

tcs_catalogue *tcs_catalogue_new(tcs_server *server) {
  tcs_catalogue *catalogue = g_new0(tcs_catalogue, 1);
  catalogue->server = server;
  catalogue->entries = g_hash_table_new_full(g_str_hash, g_str_equal, NULL, free_entry);
  return catalogue;
}

void tcs_catalogue_free(tcs_catalogue *catalogue) {
  if (!catalogue) return;
  g_hash_table_destroy(catalogue->entries);
  g_free(catalogue);
}

tcs_entry *tcs_catalogue_find(tcs_catalogue *catalogue, const char *id) {
  return g_hash_table_lookup(catalogue->entries, id);
}

tcs_entry *tcs_catalogue_resident(tcs_catalogue *catalogue, const char *id, const char *member, GError **error) {
  tcs_entry *entry = tcs_catalogue_find(catalogue, id);
  if (entry && entry->state == TCS_RESIDENT) return entry;
  if (!entry)
    tc_set_error(error, TC_ERROR_NOT_FOUND, member, "there is no such volume; GET /v1/volumes lists them");
  else if (entry->state == TCS_LOADING)
    tc_set_error(error, TC_ERROR_CONFLICT, member, "the volume is still loading; ask again when its state is resident");
  else
    tc_set_error(error, TC_ERROR_CONFLICT, member, "the volume could not be loaded: %s", entry->reason);
  return NULL;
}

static bool on_progress(void *user, double fraction) {
  tcs_load *load = user;
  atomic_store(&load->permille, (int)(CLAMP(fraction, 0.0, 1.0) * 1000));
  return !atomic_load(&load->cancel);
}

static void run_load(tcs_task *task) {
  tcs_load *load = (tcs_load *)task;
  const tc_import_options options = {.progress = on_progress, .user = load, .max_voxel_bytes = load->max_bytes};
  load->began_us = g_get_monotonic_time();
  if (atomic_load(&load->cancel))
    tc_set_error(&load->error, TC_ERROR_CANCELLED, NULL, "cancelled");
  else if (!load->source.temporary || tcs_self_contained(load->source.path, &load->error))
    load->volume = tc_import(load->source.path, &options, &load->error);
  if (load->source.temporary) unlink(load->source.path);
  if (!load->volume) return;
  tc_scene_init(&load->defaults);
  tc_scene_fit(&load->defaults, load->volume); /* walks the voxels: here, not when a session asks */
  tc_scene_share(&load->defaults);
}

/* An importer names the file it was given; a client must see its own name for it instead. */
static char *reason_for_client(const tcs_load *load) {
  GString *text = g_string_new(load->error ? load->error->message : "failed");
  char *base = g_path_get_basename(load->source.path); /* tc_import() begins with "open BASE: ", as long as this */
  const gsize length = strlen(base);
  if (g_str_has_prefix(text->str, "open ") && text->len > 5 + length && text->str[5 + length] == ':') {
    g_string_erase(text, 5, (gssize)length);
    g_string_insert(text, 5, load->name);
  }
  g_free(base);
  g_string_replace(text, load->source.path, load->name, 0);
  const char *data = load->catalogue->server->config->data;
  if (data) g_string_replace(text, data, "DATA", 0);
  return g_string_free(text, FALSE);
}

static void done_load(tcs_task *task) {
  tcs_load *load = (tcs_load *)task;
  tcs_catalogue *catalogue = load->catalogue;
  tcs_server *server = catalogue->server;
  tcs_entry *entry = load->entry;
  const size_t bytes = load->volume ? tc_volume_bytes(load->volume) : 0;
  if (load->volume && catalogue->resident_bytes + bytes > (uint64_t)server->config->limits.volume_bytes) {
    tc_set_error(&load->error, TC_ERROR_MEMORY, NULL, "the memory for volumes is used up; delete one and load again");
    tc_volume_unref(load->volume);
    load->volume = NULL;
  }
  if (!entry) {
    tc_volume_unref(load->volume);
  } else if (load->volume) {
    entry->load = NULL;
    entry->state = TCS_RESIDENT;
    entry->volume = load->volume;
    entry->defaults = load->defaults;
    memset(&load->defaults, 0, sizeof load->defaults);
    catalogue->resident_bytes += bytes;
    server->metrics->volume_loads++;
    const tc_volume_desc *desc = tc_volume_describe(load->volume);
    tcs_log(TCS_LOG_INFO, "volume.loaded", "dims=%dx%dx%d type=%s format=%s bytes=%zu ms=%.0f", desc->dims[0],
            desc->dims[1], desc->dims[2], tc_voxel_type_name(desc->type), desc->format, bytes,
            (double)(g_get_monotonic_time() - load->began_us) / 1000);
  } else {
    entry->load = NULL;
    entry->state = TCS_FAILED;
    entry->reason = reason_for_client(load);
    server->metrics->volume_failures++;
    const char *reason = load->source.operators ? entry->reason : NULL;
    tcs_log(TCS_LOG_WARN, "volume.failed", "code=%d%s%s", load->error ? load->error->code : -1,
            reason ? " reason=" : "", reason ? reason : "");
  }
  g_clear_error(&load->error);
  tc_scene_clear(&load->defaults);
  g_free(load->source.path);
  g_free(load->name);
  g_free(load);
}

bool tcs_catalogue_may_load(tcs_catalogue *catalogue, const char *id, GError **error) {
  if (!tcs_id_valid(id)) {
    tc_set_error(error, TC_ERROR_INVALID, "/id", "a volume id is 1 to 64 of letters, digits, '.', '_', '-'");
    return false;
  }
  const tcs_entry *entry = tcs_catalogue_find(catalogue, id);
  if (entry && entry->state != TCS_FAILED) {
    tc_set_error(error, TC_ERROR_CONFLICT, "/id", "there is a volume of this id already; delete it first");
    return false;
  }
  if (catalogue->resident_bytes >= (uint64_t)catalogue->server->config->limits.volume_bytes) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "the memory for volumes is used up; delete one and load again");
    return false;
  }
  return true;
}

tcs_entry *tcs_catalogue_load(tcs_catalogue *catalogue, const char *id, tcs_source_file *source, GError **error) {
  if (!tcs_catalogue_may_load(catalogue, id, error)) {
    if (source->temporary) unlink(source->path);
    g_free(source->path);
    return NULL;
  }
  g_hash_table_remove(catalogue->entries, id); /* a failed one */
  tcs_entry *entry = g_new0(tcs_entry, 1);
  g_strlcpy(entry->id, id, sizeof entry->id);
  tcs_load *load = entry->load = g_new0(tcs_load, 1);
  load->task = (tcs_task){.run = run_load, .done = done_load};
  load->catalogue = catalogue;
  load->entry = entry;
  load->source = *source;
  load->name = g_strdup(source->name);
  load->max_bytes = (uint64_t)catalogue->server->config->limits.volume_bytes - catalogue->resident_bytes;
  load->told = -1;
  atomic_init(&load->cancel, false);
  atomic_init(&load->permille, 0);
  g_hash_table_insert(catalogue->entries, entry->id, entry);
  tcs_worker_submit(catalogue->server->load_worker, &load->task);
  return entry;
}

void tcs_catalogue_remove(tcs_catalogue *catalogue, tcs_entry *entry) {
  if (entry->volume) {
    catalogue->resident_bytes -= tc_volume_bytes(entry->volume);
    tcs_scheduler_forget(catalogue->server->scheduler, entry->volume);
  }
  g_hash_table_remove(catalogue->entries, entry->id);
}

void tcs_catalogue_cancel_all(tcs_catalogue *catalogue) {
  GHashTableIter iterator;
  void *value;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (g_hash_table_iter_next(&iterator, NULL, &value)) {
    tcs_entry *entry = value;
    if (entry->load) atomic_store(&entry->load->cancel, true);
  }
}

bool tcs_catalogue_starting(tcs_catalogue *catalogue) {
  const GPtrArray *volumes = catalogue->server->config->volumes;
  for (guint i = 0; i < volumes->len; i++) {
    const tcs_named_path *named = g_ptr_array_index(volumes, i);
    const tcs_entry *entry = tcs_catalogue_find(catalogue, named->id);
    if (entry && entry->state == TCS_LOADING) return true;
  }
  return false;
}

bool tcs_catalogue_resolve(tcs_catalogue *catalogue, const char *path, tcs_source_file *source, GError **error) {
  const char *data = catalogue->server->config->data;
  *source = (tcs_source_file){.name = path};
  if (g_str_has_prefix(path, "demo:")) {
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

static void add_vector(cJSON *object, const char *name, const double *values, int count) {
  cJSON_AddItemToObject(object, name, cJSON_CreateDoubleArray(values, count));
}

static void describe_volume(cJSON *json, const tc_volume *volume) {
  const tc_volume_desc *desc = tc_volume_describe(volume);
  const tc_volume_stats *stats = tc_volume_statistics(volume);
  cJSON_AddItemToObject(json, "dims", cJSON_CreateIntArray(desc->dims, 3));
  add_vector(json, "spacing", desc->spacing, 3);
  add_vector(json, "origin", desc->origin, 3);
  cJSON *direction = cJSON_AddArrayToObject(json, "direction");
  for (int row = 0; row < 3; row++)
    cJSON_AddItemToArray(direction, cJSON_CreateDoubleArray(desc->direction + 3 * row, 3));
  cJSON_AddStringToObject(json, "type", tc_voxel_type_name(desc->type));
  add_vector(json, "range", (const double[2]){stats->min, stats->max}, 2);
  cJSON_AddNumberToObject(json, "bytes", (double)tc_volume_bytes(volume));
  cJSON_AddStringToObject(json, "modality", desc->modality);
  cJSON_AddStringToObject(json, "format", desc->format);
  cJSON_AddStringToObject(json, "unit", desc->unit);
  cJSON_AddNumberToObject(json, "slope", desc->slope);
  cJSON_AddNumberToObject(json, "intercept", desc->intercept);
  cJSON_AddNumberToObject(json, "frames", desc->frames);
  cJSON_AddStringToObject(json, "note", desc->note);
  cJSON_AddNumberToObject(json, "nonFinite", (double)stats->non_finite);
  if (desc->window_width > 0) {
    cJSON *window = cJSON_AddObjectToObject(json, "window");
    cJSON_AddNumberToObject(window, "center", desc->window_center);
    cJSON_AddNumberToObject(window, "width", desc->window_width);
  }
}

cJSON *tcs_catalogue_describe(const tcs_entry *entry) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "id", entry->id);
  cJSON_AddStringToObject(json, "state", state_names[entry->state]);
  if (entry->load) cJSON_AddNumberToObject(json, "fraction", atomic_load(&entry->load->permille) / 1000.0);
  if (entry->reason) cJSON_AddStringToObject(json, "reason", entry->reason);
  if (entry->volume) describe_volume(json, entry->volume);
  cJSON_AddNumberToObject(json, "sessions", entry->users);
  return json;
}

static int compare_ids(const void *a, const void *b) {
  return strcmp(*(const char *const *)a, *(const char *const *)b);
}

cJSON *tcs_catalogue_list(tcs_catalogue *catalogue) {
  guint count;
  const char **ids = (const char **)(void *)g_hash_table_get_keys_as_array(catalogue->entries, &count);
  qsort(ids, count, sizeof *ids, compare_ids);
  cJSON *list = cJSON_CreateArray();
  for (guint i = 0; i < count; i++)
    cJSON_AddItemToArray(list, tcs_catalogue_describe(tcs_catalogue_find(catalogue, ids[i])));
  g_free(ids);
  return list;
}

void tcs_catalogue_gauges(tcs_catalogue *catalogue, tcs_gauges *gauges) {
  GHashTableIter iterator;
  void *value;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (g_hash_table_iter_next(&iterator, NULL, &value)) {
    const tcs_entry *entry = value;
    gauges->volumes_resident += entry->state == TCS_RESIDENT;
    gauges->volumes_loading += entry->state == TCS_LOADING;
  }
  gauges->volume_bytes = catalogue->resident_bytes;
}

void tcs_catalogue_report(tcs_catalogue *catalogue, void (*tell)(void *user, const char *json), void *user) {
  GHashTableIter iterator;
  void *value;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (g_hash_table_iter_next(&iterator, NULL, &value)) {
    tcs_entry *entry = value;
    char text[160];
    if (entry->state != entry->told) {
      entry->told = entry->state;
      g_snprintf(text, sizeof text, "{\"type\":\"volume\",\"id\":\"%s\",\"state\":\"%s\",\"fraction\":1}", entry->id,
                 state_names[entry->state]);
      tell(user, text);
    }
    if (!entry->load) continue;
    const int permille = atomic_load(&entry->load->permille);
    if (permille == entry->load->told) continue;
    entry->load->told = permille;
    g_snprintf(text, sizeof text, "{\"type\":\"volume\",\"id\":\"%s\",\"state\":\"loading\",\"fraction\":%d.%03d}",
               entry->id, permille / 1000, permille % 1000);
    tell(user, text);
  }
}
