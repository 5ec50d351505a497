#include "server/memory/budget.h"

#include <pthread.h>

struct tcs_budget {
  pthread_mutex_t mutex;
  uint64_t total, voxels;
  uint64_t used[TCS_MEMORY_KIND_COUNT];
  tcs_give_fn give;
  void *user;
};

static bool is_voxels(tcs_memory_kind kind) {
  return kind == TCS_MEMORY_VOLUMES || kind == TCS_MEMORY_MESHES || kind == TCS_MEMORY_LOADS ||
         kind == TCS_MEMORY_PINNED;
}

const char *tcs_memory_kind_name(tcs_memory_kind kind) {
  static const char *const names[TCS_MEMORY_KIND_COUNT] = {"program", "volumes", "meshes", "loads",    "decoders",
                                                           "pinned",  "caches",  "frames", "pictures", "uploads"};
  return names[kind];
}

tcs_budget *tcs_budget_new(uint64_t total, uint64_t voxels) {
  tcs_budget *budget = g_new0(tcs_budget, 1);
  pthread_mutex_init(&budget->mutex, NULL);
  budget->total = total;
  budget->voxels = MIN(voxels, total);
  return budget;
}

void tcs_budget_free(tcs_budget *budget) {
  if (!budget) return;
  pthread_mutex_destroy(&budget->mutex);
  g_free(budget);
}

/* Caller holds the lock. */
static uint64_t left(const tcs_budget *budget, bool voxels) {
  const uint64_t most = voxels ? budget->voxels : budget->total;
  uint64_t used = 0;
  for (int kind = 0; kind < TCS_MEMORY_KIND_COUNT; kind++)
    if (!voxels || is_voxels((tcs_memory_kind)kind)) used += budget->used[kind];
  return used < most ? most - used : 0;
}

bool tcs_budget_resize(tcs_budget *budget, tcs_memory_kind kind, uint64_t held, uint64_t bytes) {
  pthread_mutex_lock(&budget->mutex);
  const uint64_t more = bytes > held ? bytes - held : 0;
  const bool ok = more <= left(budget, false) && (!is_voxels(kind) || more <= left(budget, true));
  if (ok) budget->used[kind] = budget->used[kind] - held + bytes;
  pthread_mutex_unlock(&budget->mutex);
  return ok;
}

void tcs_budget_count(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes) {
  pthread_mutex_lock(&budget->mutex);
  budget->used[kind] += bytes;
  pthread_mutex_unlock(&budget->mutex);
}

void tcs_budget_give(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes) {
  pthread_mutex_lock(&budget->mutex);
  budget->used[kind] -= MIN(bytes, budget->used[kind]);
  pthread_mutex_unlock(&budget->mutex);
}

void tcs_budget_move(tcs_budget *budget, tcs_memory_kind from, tcs_memory_kind to, uint64_t bytes) {
  pthread_mutex_lock(&budget->mutex);
  budget->used[from] -= MIN(bytes, budget->used[from]);
  budget->used[to] += bytes;
  pthread_mutex_unlock(&budget->mutex);
}

void tcs_budget_set(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes) {
  pthread_mutex_lock(&budget->mutex);
  budget->used[kind] = bytes;
  pthread_mutex_unlock(&budget->mutex);
}

uint64_t tcs_budget_total(const tcs_budget *budget) { return budget->total; }
uint64_t tcs_budget_voxels(const tcs_budget *budget) { return budget->voxels; }

uint64_t tcs_budget_used(tcs_budget *budget, tcs_memory_kind kind) {
  pthread_mutex_lock(&budget->mutex);
  const uint64_t bytes = budget->used[kind];
  pthread_mutex_unlock(&budget->mutex);
  return bytes;
}

static uint64_t left_locked(tcs_budget *budget, bool voxels) {
  pthread_mutex_lock(&budget->mutex);
  const uint64_t bytes = left(budget, voxels);
  pthread_mutex_unlock(&budget->mutex);
  return bytes;
}

uint64_t tcs_budget_left(tcs_budget *budget) { return left_locked(budget, false); }
uint64_t tcs_budget_left_for_voxels(tcs_budget *budget) { return left_locked(budget, true); }

bool tcs_budget_fits(tcs_budget *budget, uint64_t bytes) {
  return bytes <= left_locked(budget, false) && bytes <= left_locked(budget, true);
}

void tcs_budget_when_asked(tcs_budget *budget, tcs_give_fn give, void *user) {
  budget->give = give;
  budget->user = user;
}

bool tcs_budget_ask(tcs_budget *budget, uint64_t bytes, const void *spare) {
  return bytes <= left_locked(budget, false) || (budget->give && budget->give(budget->user, bytes, spare));
}

typedef struct counted {
  tcs_budget *budget;
  tcs_memory_kind kind;
  void *bytes;
  size_t size;
} counted;

static void free_counted(void *user) {
  counted *c = user;
  tcs_budget_give(c->budget, c->kind, c->size);
  g_free(c->bytes);
  g_free(c);
}

GBytes *tcs_budget_bytes(tcs_budget *budget, tcs_memory_kind kind, void *bytes, size_t size) {
  counted *c = g_new(counted, 1);
  *c = (counted){budget, kind, bytes, size};
  tcs_budget_count(budget, kind, size);
  return g_bytes_new_with_free_func(bytes, size, free_counted, c);
}

void tcs_budget_refuse(tcs_budget *budget, tcs_memory_kind kind, uint64_t more, GError **error) {
  GString *uses = g_string_new(NULL);
  for (int holder = 0; holder < TCS_MEMORY_KIND_COUNT; holder++) {
    const double mib = (double)tcs_budget_used(budget, (tcs_memory_kind)holder) / 0x1p20;
    if (mib >= 0.05)
      g_string_append_printf(uses, "%s%s %.1f", uses->len ? ", " : "", tcs_memory_kind_name((tcs_memory_kind)holder),
                             mib);
  }
  tc_set_error(error, TC_ERROR_BUSY, NULL,
               "the memory is used up: %s need %.1f MiB more; in use are %s of %.1f MiB (%.1f of them for volumes); "
               "delete a volume, end a session or try again later",
               tcs_memory_kind_name(kind), (double)more / 0x1p20, uses->len ? uses->str : "0",
               (double)budget->total / 0x1p20, (double)budget->voxels / 0x1p20);
  g_string_free(uses, TRUE);
}
