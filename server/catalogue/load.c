/* Imports: a bounded queue, a few at a time. Each reserves its memory before it decodes anything. */
#include <inttypes.h>
#include <string.h>

#include "server/catalogue/own.h"
#include "server/catalogue/spool.h"
#include "server/config/config.h"
#include "server/observe/log.h"
#include "server/schedule/scheduler.h"

/* How long an import waits for memory that is about to be released. */
#define MEMORY_WAIT_US 30000000

static bool on_progress(void *user, double fraction) {
  tcs_load *load = user;
  atomic_store(&load->permille, (int)(CLAMP(fraction, 0.0, 1.0) * 1000));
  if (g_get_monotonic_time() > load->deadline_us) load->late = true;
  return !load->late && !atomic_load(&load->cancel);
}

static bool on_reserve(void *user, uint64_t bytes, GError **error) {
  tcs_load *load = user;
  tcs_budget *budget = load->catalogue->server->budget;
  load->wanted = tcs_room_of(bytes);
  if (load->wanted > tcs_budget_voxels(budget)) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "it needs %.1f MiB; the limit for all volumes and meshes is %.1f MiB",
                 (double)bytes / 0x1p20, (double)tcs_budget_voxels(budget) / 0x1p20);
    return false;
  }
  if (!tcs_budget_resize(budget, TCS_MEMORY_LOADS, load->reserved, load->wanted)) {
    load->refused = true;
    tcs_budget_refuse(budget, TCS_MEMORY_LOADS, load->wanted - load->reserved, error);
    return false;
  }
  load->reserved = load->wanted;
  return true;
}

static bool on_decoder(void *user, uint64_t bytes, GError **error) {
  tcs_load *load = user;
  tcs_budget *budget = load->catalogue->server->budget;
  load->decoder_wanted = MAX(load->decoder_wanted, bytes);
  if (!tcs_budget_resize(budget, TCS_MEMORY_DECODERS, load->decoder, bytes)) {
    load->refused = true;
    tcs_budget_refuse(budget, TCS_MEMORY_DECODERS, bytes - load->decoder, error);
    return false;
  }
  load->decoder = bytes;
  return true;
}

static void name_deadline(tcs_load *load) {
  g_clear_error(&load->error);
  tc_set_error(&load->error, TC_ERROR_LIMIT, NULL, "the import takes longer than %" PRId64 " seconds and was ended",
               load->catalogue->server->config->limits.import_seconds);
}

static const tcs_kind_row *row_of(const tcs_load *load) {
  return load->kind == TCS_KIND_MESH ? &tcs_kind_mesh : &tcs_kind_volume;
}

static bool import(tcs_load *load) {
  bool good = false;
  const tcs_limits *limits = &load->catalogue->server->config->limits;
  const tc_import_options options = {.progress = on_progress,
                                     .reserve = on_reserve,
                                     .decoder = on_decoder,
                                     .user = load,
                                     .max_voxel_bytes = (uint64_t)limits->volume_bytes,
                                     .bridge_nothing = limits->bridged_slices == 0,
                                     .self_contained =
                                         load->source.upload || (load->source.series && load->source.series->upload)};
  load->began_us = g_get_monotonic_time();
  load->deadline_us = load->began_us + limits->import_seconds * 1000000;
  if (atomic_load(&load->cancel))
    tc_set_error(&load->error, TC_ERROR_CANCELLED, NULL, "cancelled");
  else
    good = row_of(load)->import(load, &options);
  on_decoder(load, 0, NULL);
  return good;
}

bool tcs_load_goes_on(void *user) {
  tcs_load *load = user;
  return !atomic_load(&load->cancel) && g_get_monotonic_time() < load->deadline_us;
}

static void run_load(tcs_task *task) {
  tcs_load *load = (tcs_load *)task;
  const bool good = import(load);
  if (load->source.upload && !load->refused && !tcs_load_is_of_series(load)) tcs_spooled_remove(load->source.upload);
  load->good = good && row_of(load)->dress(load); /* full passes run here, not when a session needs them */
  if (!load->good && load->late) name_deadline(load);
}

/* The importer's message names the server's file; the client must see the name it gave instead. */
static char *reason_for_client(const tcs_load *load) {
  GString *text = g_string_new(load->error ? load->error->message : "failed");
  char *base = g_path_get_basename(load->source.path); /* tc_import() begins with "open BASE: ", of this length */
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

static void free_load(tcs_load *load) {
  g_queue_unlink(&load->catalogue->loads, &load->link);
  tcs_budget_give(load->catalogue->server->budget, TCS_MEMORY_LOADS, load->reserved);
  tcs_spooled_free(load->source.upload);
  tcs_series_unref(load->source.series);
  g_clear_error(&load->error);
  tc_scene_clear(&load->defaults);
  tc_volume_unref(load->volume);
  tc_volume_unref(load->body);
  tc_mesh_free(load->mesh);
  g_free(load->source.path);
  g_free(load->name);
  g_free(load);
}

/* --- end of an import ------------------------------------------------------------------------------ */

typedef struct holding {
  tcs_budget *budget;
  uint64_t bytes;
  tcs_memory_kind kind; /* changed by the I/O thread while the catalogue still holds a reference */
} holding;

void tcs_hold_freed(void *user) {
  holding *held = user;
  tcs_budget_give(held->budget, held->kind, held->bytes);
  g_free(held);
}

void *tcs_hold(tcs_load *load, uint64_t bytes) {
  tcs_budget *budget = load->catalogue->server->budget;
  holding *held = g_new(holding, 1);
  *held = (holding){budget, tcs_room_of(bytes), row_of(load)->memory};
  tcs_budget_count(budget, held->kind, held->bytes);
  return held;
}

static void keep(tcs_load *load) {
  tcs_entry *entry = load->entry;
  tcs_budget_give(load->catalogue->server->budget, TCS_MEMORY_LOADS, load->reserved);
  load->reserved = 0;
  entry->state = TCS_RESIDENT;
  entry->used_us = g_get_monotonic_time();
  row_of(load)->keep(load, entry);
  if (entry->volume) tcs_preparation_begin(load->catalogue, entry, load->source.client);
}

static void fail(tcs_load *load) {
  tcs_catalogue *catalogue = load->catalogue;
  tcs_entry *entry = load->entry;
  catalogue->server->metrics->volume_failures += load->kind == TCS_KIND_VOLUME;
  char *text = reason_for_client(load);
  const char *reason = load->source.operators ? text : NULL;
  tcs_log(TCS_LOG_WARN, load->kind == TCS_KIND_MESH ? "mesh.failed" : "volume.failed", "code=%d%s%s",
          load->error ? load->error->code : -1, reason ? " reason=" : "", reason ? reason : "");
  tcs_entry_fail(catalogue, entry, text);
}

/* Whether to retry the import later: it was refused memory, and memory of other users may be released in time. */
static bool waits_for_memory(tcs_load *load) {
  if (!load->refused || !load->entry || atomic_load(&load->cancel)) return false;
  const int64_t now_us = g_get_monotonic_time();
  if (!load->asked_us) load->asked_us = now_us;
  tcs_budget_give(load->catalogue->server->budget, TCS_MEMORY_LOADS, load->reserved);
  load->reserved = 0;
  return now_us - load->asked_us < MEMORY_WAIT_US;
}

static void finish(tcs_load *load) {
  if (load->entry) load->entry->load = NULL;
  if (load->entry && load->good)
    keep(load);
  else if (load->entry)
    fail(load);
  free_load(load);
}

static void done_load(tcs_task *task) {
  tcs_load *load = (tcs_load *)task;
  tcs_catalogue *catalogue = load->catalogue;
  load->running = false;
  catalogue->running--;
  if (!waits_for_memory(load)) finish(load);
  tcs_loads_pump(catalogue);
}

/* --- the queue ------------------------------------------------------------------------------------- */

static int64_t count_of(const tcs_catalogue *catalogue, const char *client, bool running) {
  int64_t count = 0;
  for (const GList *item = catalogue->loads.head; item; item = item->next) {
    const tcs_load *load = item->data;
    const bool own = !client || strcmp(load->source.client, client) == 0;
    count += own && (load->running || !running) && !load->source.operators;
  }
  return count;
}

bool tcs_loads_allow(const tcs_catalogue *catalogue, const char *client, GError **error) {
  const tcs_limits *limits = &catalogue->server->config->limits;
  if (!client) return true;
  if (count_of(catalogue, client, false) >= limits->loads_per_client)
    tc_set_error(error, TC_ERROR_BUSY, NULL,
                 "%" PRId64 " volumes and meshes of this client are loading, which is the limit; try again later",
                 limits->loads_per_client);
  else if (count_of(catalogue, NULL, false) >= limits->loads)
    tc_set_error(error, TC_ERROR_BUSY, NULL,
                 "%" PRId64 " volumes and meshes are loading, which is the limit; try again later", limits->loads);
  else
    return true;
  return false;
}

static bool fits(tcs_budget *budget, const tcs_load *load) {
  return tcs_budget_fits(budget, load->wanted) && load->wanted + load->decoder_wanted <= tcs_budget_left(budget);
}

/* Whether the memory an import was refused is available now. *give_up: it is not, and will not become available. */
static bool has_memory(tcs_load *load, bool *give_up) {
  tcs_catalogue *catalogue = load->catalogue;
  tcs_budget *budget = catalogue->server->budget;
  if (!load->refused || fits(budget, load)) return true;
  const bool coming = tcs_room_make(catalogue, load->wanted, load->decoder_wanted) || catalogue->running > 0 ||
                      tcs_budget_used(budget, TCS_MEMORY_PINNED) > 0;
  *give_up = !coming || g_get_monotonic_time() - load->asked_us > MEMORY_WAIT_US;
  return fits(budget, load);
}

/* One thread stays free of each client's imports, so that its long imports do not block other clients. */
static bool may_start(const tcs_load *load) {
  return load->source.operators || count_of(load->catalogue, load->source.client, true) < TCS_LOAD_THREADS - 1;
}

static void start(tcs_load *load) {
  load->running = true;
  load->catalogue->running++;
  load->refused = load->late = false;
  g_clear_error(&load->error);
  tcs_worker_submit(load->catalogue->server->load_worker, &load->task);
}

void tcs_loads_pump(tcs_catalogue *catalogue) {
  if (catalogue->ended) return;
  for (GList *item = catalogue->loads.head, *next; item && catalogue->running < TCS_LOAD_THREADS; item = next) {
    tcs_load *load = item->data;
    bool give_up = false;
    next = item->next;
    if (load->running || !may_start(load)) continue;
    if (has_memory(load, &give_up))
      start(load);
    else if (give_up)
      finish(load);
  }
}

void tcs_load_begin(tcs_catalogue *catalogue, tcs_entry *entry, const tcs_source_file *source) {
  tcs_load *load = entry->load = g_new0(tcs_load, 1);
  load->task = (tcs_task){.run = run_load, .done = done_load};
  load->link.data = load;
  load->catalogue = catalogue;
  load->entry = entry;
  load->kind = entry->kind;
  load->source = *source;
  load->name = g_strdup(source->name);
  load->told = -1;
  atomic_init(&load->cancel, false);
  atomic_init(&load->permille, 0);
  g_queue_push_tail_link(&catalogue->loads, &load->link);
  tcs_loads_pump(catalogue);
}

void tcs_load_leave(tcs_load *load) {
  load->entry = NULL;
  if (load->running)
    atomic_store(&load->cancel, true);
  else
    free_load(load);
}

static void pin(void **held_of_entry) {
  holding *held = g_steal_pointer(held_of_entry);
  if (!held) return;
  tcs_budget_move(held->budget, held->kind, TCS_MEMORY_PINNED, held->bytes);
  held->kind = TCS_MEMORY_PINNED;
}

uint64_t tcs_volume_bytes(const tc_volume *volume) {
  const tc_volume *gaps = tc_volume_gaps(volume), *colors = tc_volume_colors(volume);
  return tc_volume_bytes(volume) + (gaps ? tc_volume_bytes(gaps) : 0) + (colors ? tc_volume_bytes(colors) : 0);
}

uint64_t tcs_entry_bytes(const tcs_entry *entry) {
  if (entry->mesh) return entry->mesh->bytes;
  return tcs_volume_bytes(entry->volume) + (entry->body ? tcs_volume_bytes(entry->body) : 0);
}

void tcs_entry_release(tcs_catalogue *catalogue, tcs_entry *entry) {
  if (!entry->volume && !entry->mesh) return;
  tcs_preparation_end(entry);
  g_clear_pointer(&entry->thumbnail, g_bytes_unref);
  pin(&entry->held);
  pin(&entry->held_body);
  tc_scene_clear(&entry->defaults);
  memset(&entry->defaults, 0, sizeof entry->defaults);
  if (entry->volume) tcs_scheduler_forget(catalogue->server->scheduler, entry->volume);
  if (entry->body) tcs_scheduler_forget(catalogue->server->scheduler, entry->body);
  if (entry->mesh) tcs_scheduler_forget_mesh(catalogue->server->scheduler, entry->mesh->serial);
  g_clear_pointer(&entry->volume, tc_volume_unref);
  g_clear_pointer(&entry->body, tc_volume_unref);
  g_clear_pointer(&entry->mesh, tc_mesh_free);
}
