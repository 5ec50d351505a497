/* What frames share, of any kind, by bytes that say what it was made from: one budget and one rule of age for all
 * kinds. The render thread's. */
#ifndef TC_RENDERER_STORE_H
#define TC_RENDERER_STORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"

typedef struct tc_store_kind {
  const char *name; /* for errors */
  void (*free)(void *thing);
  void (*abandon)(void *thing); /* of one that is still in the making; NULL: free() */
  bool displaces_all;           /* room for one is made at the expense of any kind, not of its own alone */
  int most_once;                /* so many are kept of those that one frame alone used: an edit's, while it goes on; 0: all */
} tc_store_kind;

typedef struct tc_stored {
  const tc_store_kind *kind;
  void *key;
  size_t key_size;
  void *thing;     /* owned */
  bool unfinished; /* in the making */
  size_t bytes;
  double ms;       /* what building took, as its owner counts it */
  uint64_t last_use;
  int uses;
  uint64_t volume; /* serial of the volume it goes with; 0: none */
} tc_stored;

typedef struct tc_store tc_store;

tc_store *tc_store_new(uint64_t budget_bytes, GError **error);
void tc_store_free(tc_store *store); /* NULL is fine */

/* In the making or finished; NULL: not there. Not yet a use. The pointer is good until something is added. */
tc_stored *tc_store_find(const tc_store *store, const tc_store_kind *kind, const void *key, size_t key_size);
/* The one in use last of which `like` is true. */
tc_stored *tc_store_latest(const tc_store *store, const tc_store_kind *kind,
                           bool (*like)(const void *thing, const void *user), const void *user);
/* Takes the thing: on failure (TC_ERROR_MEMORY) it is freed, as unfinished. Finished things of the kind, oldest first,
 * make room for its bytes: what a frame already has of other kinds stays. */
tc_stored *tc_store_add(tc_store *store, const tc_store_kind *kind, const void *key, size_t key_size, uint64_t volume,
                        void *thing, size_t bytes, GError **error);
/* Whether it may: TC_ERROR_MEMORY. Older ones of its kind go for it. */
bool tc_store_may_grow(tc_store *store, const tc_stored *stored, size_t bytes, GError **error);
/* It takes so many bytes more from now on. */
void tc_store_grow(tc_store *store, tc_stored *stored, size_t bytes);
/* It takes no more than so many from now on. */
void tc_store_shrink(tc_store *store, tc_stored *stored, size_t bytes);
/* The thing, in use now; NULL for NULL and for one in the making. */
const void *tc_store_use(tc_store *store, tc_stored *stored);

/* Drops what goes with a volume. */
void tc_store_forget(tc_store *store, uint64_t volume_serial);
/* Drops those of a kind of which `like` is true, and all of it that are in the making. */
void tc_store_drop(tc_store *store, const tc_store_kind *kind, bool (*like)(const void *thing, const void *user), const void *user);
uint64_t tc_store_held(const tc_store *store);
uint64_t tc_store_spare(const tc_store *store); /* that others may take: what there is at all, less what is held */
uint64_t tc_store_budget(const tc_store *store); /* as it was made with */
/* What there is at all from now on; the budget is as it was made, or this where it is less. Drops what is over it. */
void tc_store_limit(tc_store *store, uint64_t most_bytes);
/* Bytes of what did not, where that was what failed last; 0 then until the next failure. */
uint64_t tc_store_wanted(tc_store *store);

#endif
