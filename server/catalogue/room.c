/* Eviction: the order in which memory is released. */
#include <inttypes.h>

#include "server/catalogue/own.h"
#include "server/config/config.h"
#include "server/observe/log.h"
#include "server/schedule/scheduler.h"

/* Whole pages, one page more for the alignment, one for the descriptor. */
uint64_t tcs_room_of(uint64_t voxel_bytes) { return (voxel_bytes + 4095) / 4096 * 4096 + 8192; }

/* Bytes missing: in the whole budget, and in the voxels' share. */
typedef struct shortage {
  uint64_t any, voxels;
} shortage;

static uint64_t minus(uint64_t bytes, uint64_t less) { return bytes > less ? bytes - less : 0; }

/* Pinned memory (removed but still referenced) will be released without eviction. */
static shortage shortage_of(tcs_budget *budget, uint64_t bytes, uint64_t voxels) {
  const uint64_t coming = tcs_budget_used(budget, TCS_MEMORY_PINNED);
  return (shortage){minus(bytes, tcs_budget_left(budget) + coming),
                    minus(voxels, tcs_budget_left_for_voxels(budget) + coming)};
}

static int by_age(const void *a, const void *b) {
  const tcs_entry *const *x = a, *const *y = b;
  if ((*x)->operators != (*y)->operators) return (*x)->operators ? 1 : -1;
  return (*x)->used_us < (*y)->used_us ? -1 : (*x)->used_us > (*y)->used_us;
}

/* Volumes and meshes that no session shows, sorted by eviction order; without `spare`, which a picture is using. */
static GPtrArray *idle_entries(tcs_catalogue *catalogue, const tc_volume *spare, uint64_t *bytes) {
  GPtrArray *idle = g_ptr_array_new();
  GHashTableIter iterator;
  void *value;
  *bytes = 0;
  g_hash_table_iter_init(&iterator, catalogue->entries);
  while (g_hash_table_iter_next(&iterator, &value, NULL)) {
    const tcs_entry *entry = value;
    if (entry->state != TCS_RESIDENT || entry->users > 0) continue;
    if (spare && (entry->volume == spare || entry->body == spare)) continue;
    *bytes += tcs_room_of(tcs_entry_bytes(entry));
    g_ptr_array_add(idle, value);
  }
  g_ptr_array_sort(idle, by_age);
  return idle;
}

static bool suffices(tcs_budget *budget, const shortage *missing, uint64_t idle_bytes) {
  return missing->voxels <= idle_bytes && missing->any <= idle_bytes + tcs_budget_used(budget, TCS_MEMORY_CACHES);
}

bool tcs_room_possible(tcs_catalogue *catalogue, uint64_t bytes) {
  const shortage missing = shortage_of(catalogue->server->budget, bytes, bytes);
  uint64_t idle_bytes;
  g_ptr_array_unref(idle_entries(catalogue, NULL, &idle_bytes));
  return suffices(catalogue->server->budget, &missing, idle_bytes);
}

static void drop(tcs_catalogue *catalogue, tcs_entry *entry) {
  const bool mesh = entry->kind == TCS_KIND_MESH;
  tcs_log(TCS_LOG_INFO, mesh ? "mesh.dropped" : "volume.dropped", "bytes=%" PRIu64, tcs_entry_bytes(entry));
  catalogue->server->metrics->volume_drops += !mesh;
  tcs_entry_release(catalogue, entry);
  tcs_entry_fail(catalogue, entry, g_strdup("it was dropped to make room for others; load it again"));
}

static bool make(tcs_catalogue *catalogue, uint64_t bytes, uint64_t voxels, const tc_volume *spare) {
  tcs_budget *budget = catalogue->server->budget;
  const uint64_t cached = tcs_budget_used(budget, TCS_MEMORY_CACHES);
  const shortage missing = shortage_of(budget, bytes, voxels);
  uint64_t idle_bytes;
  GPtrArray *idle = idle_entries(catalogue, spare, &idle_bytes);
  const bool enough = suffices(budget, &missing, idle_bytes);
  if (enough && missing.any && cached)
    tcs_scheduler_trim_cache(catalogue->server->scheduler, minus(cached, missing.any));
  uint64_t goal = MAX(missing.voxels, minus(missing.any, cached));
  for (guint i = 0; enough && i < idle->len && goal > 0; i++) {
    tcs_entry *entry = g_ptr_array_index(idle, i);
    goal = minus(goal, tcs_room_of(tcs_entry_bytes(entry)));
    drop(catalogue, entry);
  }
  g_ptr_array_unref(idle);
  return enough;
}

bool tcs_room_make(tcs_catalogue *catalogue, uint64_t voxel_bytes, uint64_t more_bytes) {
  return make(catalogue, voxel_bytes + more_bytes, voxel_bytes, NULL);
}

bool tcs_room_give(void *catalogue, uint64_t bytes, const void *spare) { return make(catalogue, bytes, 0, spare); }
