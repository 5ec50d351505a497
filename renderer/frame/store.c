#include "renderer/frame/store.h"

#include <stdlib.h>
#include <string.h>

struct tc_store {
  uint64_t most, budget, held, clock; /* budget: `most`, or less where there is less */
  uint64_t ceiling, wanted; /* what there is at all; bytes of the last thing that did not fit under it, 0 = none */
  tc_stored **items;
  int count, capacity;
};

tc_store *tc_store_new(uint64_t budget_bytes, GError **error) {
  tc_store *s = calloc(1, sizeof *s);
  if (!s) tc_set_error(error, TC_ERROR_MEMORY, NULL, "renderer: out of memory");
  if (!s) return NULL;
  s->most = s->budget = budget_bytes;
  s->ceiling = UINT64_MAX;
  return s;
}

static void free_thing(const tc_store_kind *kind, void *thing, bool unfinished) {
  if (thing) (unfinished && kind->abandon ? kind->abandon : kind->free)(thing);
}

static void drop(tc_store *s, int i) {
  tc_stored *it = s->items[i];
  free_thing(it->kind, it->thing, it->unfinished);
  s->held -= it->bytes;
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

/* Makes the budget hold `bytes` more, oldest first; kind NULL: any. */
static void make_room(tc_store *s, const tc_store_kind *kind, size_t bytes, const tc_stored *keep) {
  while (s->held + bytes > s->budget) {
    int oldest = -1;
    for (int i = 0; i < s->count; i++)
      if ((!kind || kind->displaces_all || s->items[i]->kind == kind) && s->items[i] != keep &&
          (oldest < 0 || s->items[i]->last_use < s->items[oldest]->last_use))
        oldest = i;
    if (oldest < 0) break;
    drop(s, oldest);
  }
}

/* Drops the oldest of those that were used once, where there are more than the kind keeps. */
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
    if (it->unfinished && kind->abandon) continue; /* it may be something else yet */
    if (it->kind == kind && (!latest || it->last_use > latest->last_use) && like(it->thing, user)) latest = it;
  }
  return latest;
}

static bool fits(tc_store *s, size_t bytes) {
  const bool under = bytes <= s->ceiling && s->held <= s->ceiling - bytes;
  s->wanted = under ? 0 : bytes;
  return under;
}

bool tc_store_may_grow(tc_store *s, const tc_stored *stored, size_t bytes, GError **error) {
  if (!fits(s, bytes)) make_room(s, stored->kind, bytes, stored);
  if (fits(s, bytes)) return true;
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "%s: out of memory", stored->kind->name);
  return false;
}

uint64_t tc_store_wanted(tc_store *s) {
  const uint64_t wanted = s->wanted;
  s->wanted = 0;
  return wanted;
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
  make_room(s, wanted->kind, wanted->bytes, NULL);
  tc_stored *it = calloc(1, sizeof *it);
  void *copy = malloc(wanted->key_size);
  if (!fits(s, wanted->bytes) || !it || !copy || !grow_list(s)) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "%s: out of memory", wanted->kind->name);
    free_thing(wanted->kind, wanted->thing, true);
    free(it);
    free(copy);
    return NULL;
  }
  *it = *wanted;
  it->key = memcpy(copy, wanted->key, wanted->key_size);
  it->last_use = ++s->clock;
  s->held += it->bytes;
  return s->items[s->count++] = it;
}

void tc_store_grow(tc_store *s, tc_stored *stored, size_t bytes) {
  make_room(s, stored->kind, bytes, stored);
  stored->bytes += bytes;
  s->held += bytes;
}

void tc_store_shrink(tc_store *s, tc_stored *stored, size_t bytes) {
  if (bytes >= stored->bytes) return;
  s->held -= stored->bytes - bytes;
  stored->bytes = bytes;
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
uint64_t tc_store_spare(const tc_store *s) { return s->held < s->ceiling ? s->ceiling - s->held : 0; }
uint64_t tc_store_budget(const tc_store *s) { return s->most; }

void tc_store_limit(tc_store *s, uint64_t most_bytes) {
  s->ceiling = most_bytes;
  s->budget = most_bytes < s->most ? most_bytes : s->most;
  make_room(s, NULL, 0, NULL);
}
