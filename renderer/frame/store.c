#include "renderer/frame/store.h"

#include <stdlib.h>
#include <string.h>

struct tc_store {
  const tc_ledger *ledger;
  uint64_t budget, held, clock;
  tc_stored **items;
  int count, capacity;
};

tc_store *tc_store_new(uint64_t budget_bytes, const tc_ledger *ledger, GError **error) {
  tc_store *s = calloc(1, sizeof *s);
  if (!s) tc_set_error(error, TC_ERROR_MEMORY, NULL, "renderer: out of memory");
  if (!s) return NULL;
  s->budget = budget_bytes;
  s->ledger = ledger;
  return s;
}

static void free_thing(const tc_store_kind *kind, void *thing, bool unfinished) {
  if (thing) (unfinished && kind->abandon ? kind->abandon : kind->free)(thing);
}

/* Accounts for bytes already allocated, or (negative) freed. */
static void count(tc_store *s, int64_t bytes) {
  s->held += (uint64_t)bytes;
  tc_ledger_count(s->ledger, bytes);
}

static void drop(tc_store *s, int i) {
  tc_stored *it = s->items[i];
  free_thing(it->kind, it->thing, it->unfinished);
  count(s, -(int64_t)it->bytes);
  free(it->key);
  free(it);
  s->items[i] = s->items[--s->count];
}

void tc_store_free(tc_store *store) {
  if (!store) return;
  while (store->count)
    drop(store, store->count - 1);
  free(store->items);
  free(store);
}

/* Evicts the least recently used thing of a kind, or of any kind if kind is NULL or displaces all. False: there is none
 * but `keep`. */
static bool drop_oldest(tc_store *s, const tc_store_kind *kind, const tc_stored *keep) {
  int oldest = -1;
  for (int i = 0; i < s->count; i++)
    if ((!kind || kind->displaces_all || s->items[i]->kind == kind) && s->items[i] != keep &&
        (oldest < 0 || s->items[i]->last_use < s->items[oldest]->last_use))
      oldest = i;
  if (oldest >= 0) drop(s, oldest);
  return oldest >= 0;
}

/* Reserves bytes. One frame's resources may exceed the budget, but not the ledger's. */
static bool reserve(tc_store *s, const tc_store_kind *kind, size_t bytes, const tc_stored *keep, GError **error) {
  while (s->held + bytes > s->budget && drop_oldest(s, kind, keep)) {}
  while (!tc_ledger_take(s->ledger, bytes)) {
    if (drop_oldest(s, kind, keep)) continue;
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "%s: out of memory", kind->name);
    return false;
  }
  s->held += bytes;
  return true;
}

/* Drops the oldest of the things of a kind that were used only once, if there are more than most_once. */
static void drop_once_used(tc_store *s, const tc_store_kind *kind) {
  int oldest = -1, count = 0;
  for (int i = 0; i < s->count; i++) {
    if (s->items[i]->kind != kind || s->items[i]->uses > 1 || s->items[i]->unfinished) continue;
    if (oldest < 0 || s->items[i]->last_use < s->items[oldest]->last_use) oldest = i;
    count++;
  }
  if (kind->most_once && count > kind->most_once) drop(s, oldest);
}

tc_stored *tc_store_find(const tc_store *s, const tc_store_kind *kind, const void *key, size_t key_size) {
  for (int i = 0; i < s->count; i++) {
    tc_stored *it = s->items[i];
    if (it->kind == kind && it->key_size == key_size && !memcmp(it->key, key, key_size)) return it;
  }
  return NULL;
}

tc_stored *tc_store_latest(const tc_store *s, const tc_store_kind *kind,
                           bool (*like)(const void *thing, const void *user), const void *user) {
  tc_stored *latest = NULL;
  for (int i = 0; i < s->count; i++) {
    tc_stored *it = s->items[i];
    if (it->unfinished && kind->abandon) continue; /* an unfinished thing is of another type */
    if (it->kind == kind && (!latest || it->last_use > latest->last_use) && like(it->thing, user)) latest = it;
  }
  return latest;
}

static bool grow_list(tc_store *s) {
  if (s->count < s->capacity) return true;
  int capacity = s->capacity ? 2 * s->capacity : 32;
  tc_stored **grown = realloc(s->items, (size_t)capacity * sizeof *grown);
  if (!grown) return false;
  s->items = grown;
  s->capacity = capacity;
  return true;
}

tc_stored *tc_store_add(tc_store *s, const tc_stored *wanted, GError **error) {
  drop_once_used(s, wanted->kind);
  tc_stored *it = calloc(1, sizeof *it);
  void *copy = malloc(wanted->key_size);
  const bool lists = it && copy && grow_list(s);
  if (!lists) tc_set_error(error, TC_ERROR_MEMORY, NULL, "%s: out of memory", wanted->kind->name);
  if (!lists || !reserve(s, wanted->kind, wanted->bytes, NULL, error)) {
    free_thing(wanted->kind, wanted->thing, true);
    free(it);
    free(copy);
    return NULL;
  }
  *it = *wanted;
  it->key = memcpy(copy, wanted->key, wanted->key_size);
  it->last_use = ++s->clock;
  return s->items[s->count++] = it;
}

bool tc_store_grow(tc_store *s, tc_stored *stored, size_t bytes, GError **error) {
  if (!reserve(s, stored->kind, bytes, stored, error)) return false;
  stored->bytes += bytes;
  return true;
}

void tc_store_resize(tc_store *s, tc_stored *stored, size_t bytes) {
  count(s, (int64_t)bytes - (int64_t)stored->bytes);
  stored->bytes = bytes;
  while (s->held > s->budget && drop_oldest(s, stored->kind, stored)) {}
}

const void *tc_store_use(tc_store *s, tc_stored *stored) {
  if (!stored) return NULL;
  stored->last_use = ++s->clock;
  stored->uses++;
  return stored->unfinished ? NULL : stored->thing;
}

void tc_store_forget(tc_store *s, uint64_t volume_serial) {
  for (int i = s->count - 1; i >= 0; i--)
    if (s->items[i]->volume == volume_serial) drop(s, i);
}

void tc_store_drop(tc_store *s, const tc_store_kind *kind, bool (*like)(const void *thing, const void *user), const void *user) {
  for (int i = s->count - 1; i >= 0; i--) {
    const tc_stored *it = s->items[i];
    if (it->kind == kind && (it->unfinished || like(it->thing, user))) drop(s, i);
  }
}

uint64_t tc_store_held(const tc_store *s) { return s->held; }
uint64_t tc_store_budget(const tc_store *s) { return s->budget; }

void tc_store_trim(tc_store *s, uint64_t most_bytes) {
  while (s->held > most_bytes && drop_oldest(s, NULL, NULL)) {}
}
