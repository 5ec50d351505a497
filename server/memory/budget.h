/* The ledger of the daemon's memory: one total, a part of the total for voxels, and the bytes of each holder. Any
 * thread.
 *
 * Memory that can be refused is reserved before its allocation; memory that exists already is only counted. */
#ifndef TCS_MEMORY_BUDGET_H
#define TCS_MEMORY_BUDGET_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/base/error.h"

typedef enum tcs_memory_kind {
  TCS_MEMORY_PROGRAM,  /* what it was resident at its start */
  TCS_MEMORY_VOLUMES,  /* resident volumes */
  TCS_MEMORY_MESHES,   /* resident meshes */
  TCS_MEMORY_LOADS,    /* reserved by imports under way */
  TCS_MEMORY_DECODERS, /* programs that decode beside this one */
  TCS_MEMORY_PINNED,   /* volumes that were removed and are still being used */
  TCS_MEMORY_CACHES,   /* the renderer's tables, coefficients and structures */
  TCS_MEMORY_FRAMES,   /* pictures being rendered and encoded */
  TCS_MEMORY_PICTURES, /* encoded pictures */
  TCS_MEMORY_UPLOADS,  /* bytes on their way to the spool */
  TCS_MEMORY_KIND_COUNT
} tcs_memory_kind;

const char *tcs_memory_kind_name(tcs_memory_kind kind); /* "program" "volumes" ... */

typedef struct tcs_budget tcs_budget;

/* `voxels`: how much of the total volumes, meshes, loads and pinned ones may hold together. */
tcs_budget *tcs_budget_new(uint64_t total, uint64_t voxels);
void tcs_budget_free(tcs_budget *budget); /* NULL is fine */

/* Changes a holder's bytes of a kind from `held` to `bytes`. False: the memory is short, and nothing changed. */
bool tcs_budget_resize(tcs_budget *budget, tcs_memory_kind kind, uint64_t held, uint64_t bytes);
/* Counts memory that exists already, even beyond the total. */
void tcs_budget_count(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes);
void tcs_budget_give(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes);
void tcs_budget_move(tcs_budget *budget, tcs_memory_kind from, tcs_memory_kind to, uint64_t bytes);
/* The whole of a kind that one holder alone has. */
void tcs_budget_set(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes);

uint64_t tcs_budget_total(const tcs_budget *budget);
uint64_t tcs_budget_voxels(const tcs_budget *budget);
uint64_t tcs_budget_used(tcs_budget *budget, tcs_memory_kind kind);
/* What is left of the whole, and of the voxels' part of it. */
uint64_t tcs_budget_left(tcs_budget *budget);
uint64_t tcs_budget_left_for_voxels(tcs_budget *budget);
/* Memory is missing: whoever can is asked to give back what was not used for long, but `spare` (a volume, or NULL),
 * until `bytes` are left. False: there is not that much, and nothing was given back; true: it is there, or on its way
 * through the render thread, in the order of its tasks. I/O thread. */
bool tcs_budget_ask(tcs_budget *budget, uint64_t bytes, const void *spare);
/* Who is asked. */
typedef bool (*tcs_give_fn)(void *user, uint64_t bytes, const void *spare);
void tcs_budget_when_asked(tcs_budget *budget, tcs_give_fn give, void *user);

/* Whether voxels of this many bytes may be taken. */
bool tcs_budget_fits(tcs_budget *budget, uint64_t bytes);

/* Bytes that are counted until the last reference to them goes, wherever that is; takes `bytes`, of g_malloc. */
GBytes *tcs_budget_bytes(tcs_budget *budget, tcs_memory_kind kind, void *bytes, size_t size);

/* "the memory is used up: loads need 30 MiB more; in use are volumes 180, caches 12 of 200 MiB; ..." as TC_ERROR_BUSY
 * (503): `kind` is the holder that was refused `more` bytes. */
void tcs_budget_refuse(tcs_budget *budget, tcs_memory_kind kind, uint64_t more, GError **error);

#endif
