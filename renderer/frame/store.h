/* Cache of resources of all kinds: found by a key of bytes, one budget, least recently used first out. Used by the render
 * thread alone. */
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
  int most_once;                /* how many used by a single frame are kept (a drag makes one a frame); 0: all */
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
  uint64_t volume; /* serial of the volume whose end drops it; 0: none */
} tc_stored;

typedef struct tc_store tc_store;

/* ledger: is asked for all that is kept, and outlives the store; NULL: no bound but the budget, which one frame may exceed. */
tc_store *tc_store_new(uint64_t budget_bytes, const tc_ledger *ledger, GError **error);
void tc_store_free(tc_store *store); /* NULL is fine */

/* Finished or unfinished; NULL: not cached. Does not count as a use. The pointer is valid until the next addition. */
tc_stored *tc_store_find(const tc_store *store, const tc_store_kind *kind, const void *key, size_t key_size);
/* The most recently used one for which `like` is true. */
tc_stored *tc_store_latest(const tc_store *store, const tc_store_kind *kind,
                           bool (*like)(const void *thing, const void *user), const void *user);
/* Takes ownership of wanted->thing, which is unfinished; on failure (TC_ERROR_MEMORY) frees the thing. Copies the key.
 * Evicts finished things of the kind, oldest first: resources of other kinds, which this frame may already hold, stay. */
tc_stored *tc_store_add(tc_store *store, const tc_stored *wanted, GError **error);
/* Reserves so many bytes more for it, evicting older ones of its kind; else TC_ERROR_MEMORY. */
bool tc_store_grow(tc_store *store, tc_stored *stored, size_t bytes, GError **error);
/* It has so many bytes now, whatever was reserved. */
void tc_store_resize(tc_store *store, tc_stored *stored, size_t bytes);
/* The thing, marked as used now; NULL for NULL and for an unfinished one. */
const void *tc_store_use(tc_store *store, tc_stored *stored);

/* Drops the things of a volume. */
void tc_store_forget(tc_store *store, uint64_t volume_serial);
/* Drops those of a kind for which `like` is true, and all unfinished ones of the kind. */
void tc_store_drop(tc_store *store, const tc_store_kind *kind, bool (*like)(const void *thing, const void *user), const void *user);
uint64_t tc_store_held(const tc_store *store);
uint64_t tc_store_budget(const tc_store *store); /* as given to tc_store_new() */
/* Drops the least recently used until at most so many bytes are held. */
void tc_store_trim(tc_store *store, uint64_t most_bytes);

#endif
