/* Cache of resources of all kinds, found by a key of bytes, with one budget and LRU eviction. Render thread only. */
#ifndef TC_RENDERER_STORE_H
#define TC_RENDERER_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"
#include "renderer/base/ledger.h"

typedef struct tc_store_kind {
  const char *name; /* for errors */
  void (*free)(void *thing);
  void (*abandon)(void *thing); /* frees an unfinished one; NULL: free() */
  bool displaces_all;           /* may evict resources of every kind, not only of its own */
  int most_once;                /* limit on resources that only one frame used (a drag makes one per frame); 0: none */
} tc_store_kind;

typedef struct tc_stored {
  const tc_store_kind *kind;
  void *key;
  size_t key_size;
  void *thing;     /* owned */
  bool unfinished; /* still being built */
  size_t bytes;
  double ms;       /* time of building, as the owner counts it */
  uint64_t last_use;
  int uses;
  uint64_t volume; /* dropped with the volume of this serial; 0: none */
} tc_stored;

typedef struct tc_store tc_store;

/* ledger: all stored bytes are reserved there; outlives the store. NULL: only the budget, which a single frame may
 * exceed. */
tc_store *tc_store_new(uint64_t budget_bytes, const tc_ledger *ledger, GError **error);
void tc_store_free(tc_store *store); /* NULL is fine */

/* Finds a resource, finished or unfinished; NULL: not cached. Does not count as a use. The pointer is valid until the
 * next addition. */
tc_stored *tc_store_find(const tc_store *store, const tc_store_kind *kind, const void *key, size_t key_size);
/* The most recently used resource of a kind for which `like` is true; NULL: none. */
tc_stored *tc_store_latest(const tc_store *store, const tc_store_kind *kind,
                           bool (*like)(const void *thing, const void *user), const void *user);
/* Takes ownership of wanted->thing; on failure (TC_ERROR_MEMORY) frees the thing. Copies the key. Evicts things of the
 * same kind, least recently used first: this frame may already hold resources of other kinds. */
tc_stored *tc_store_add(tc_store *store, const tc_stored *wanted, GError **error);
/* Reserves `bytes` more for a stored thing, evicting others of its kind. False with TC_ERROR_MEMORY. */
bool tc_store_grow(tc_store *store, tc_stored *stored, size_t bytes, GError **error);
/* Sets the size of a stored thing to the bytes it really has, whatever was reserved. */
void tc_store_resize(tc_store *store, tc_stored *stored, size_t bytes);
/* Marks as used and returns the thing; NULL if stored is NULL or the thing is unfinished. */
const void *tc_store_use(tc_store *store, tc_stored *stored);

/* Drops the things of a volume. */
void tc_store_forget(tc_store *store, uint64_t volume_serial);
/* Drops the things of a kind for which `like` is true, and all unfinished ones of that kind. */
void tc_store_drop(tc_store *store, const tc_store_kind *kind, bool (*like)(const void *thing, const void *user), const void *user);
uint64_t tc_store_held(const tc_store *store);
uint64_t tc_store_budget(const tc_store *store); /* as given to tc_store_new() */
/* Evicts the least recently used until at most most_bytes are held. */
void tc_store_trim(tc_store *store, uint64_t most_bytes);

#endif
