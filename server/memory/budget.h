/* The daemon's memory budget: one total, a share of the total for voxels, and the bytes in use by kind. Any thread.
 *
 * Memory whose allocation can be refused is reserved first; memory that exists already is only counted. */
#ifndef TCS_MEMORY_BUDGET_H
#define TCS_MEMORY_BUDGET_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/base/error.h"

typedef enum tcs_memory_kind {
  TCS_MEMORY_PROGRAM,  /* resident size of the process at its start */
  TCS_MEMORY_VOLUMES,  /* resident volumes */
  TCS_MEMORY_MESHES,   /* resident meshes */
  TCS_MEMORY_LOADS,    /* reserved by running imports */
  TCS_MEMORY_DECODERS, /* decoder processes */
  TCS_MEMORY_PINNED,   /* volumes removed from the catalogue but still referenced */
  TCS_MEMORY_CACHES,   /* the renderer's tables, coefficients and acceleration structures */
  TCS_MEMORY_FRAMES,   /* pictures being rendered and encoded */
  TCS_MEMORY_PICTURES, /* encoded pictures */
  TCS_MEMORY_UPLOADS,  /* bytes queued for the spool */
  TCS_MEMORY_KIND_COUNT
} tcs_memory_kind;

const char *tcs_memory_kind_name(tcs_memory_kind kind); /* "program" "volumes" ... */

typedef struct tcs_budget tcs_budget;

/* `voxels`: the share of the total that volumes, meshes, loads and pinned volumes may hold together. */
tcs_budget *tcs_budget_new(uint64_t total, uint64_t voxels);
void tcs_budget_free(tcs_budget *budget); /* NULL is fine */

/* Changes a holder's reservation of a kind from `held` to `bytes`. False: not enough memory, nothing changed. */
bool tcs_budget_resize(tcs_budget *budget, tcs_memory_kind kind, uint64_t held, uint64_t bytes);
/* Counts memory that exists already, even beyond the total. */
void tcs_budget_count(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes);
void tcs_budget_give(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes);
void tcs_budget_move(tcs_budget *budget, tcs_memory_kind from, tcs_memory_kind to, uint64_t bytes);
/* Sets the total of a kind that has a single holder. */
void tcs_budget_set(tcs_budget *budget, tcs_memory_kind kind, uint64_t bytes);

uint64_t tcs_budget_total(const tcs_budget *budget);
uint64_t tcs_budget_voxels(const tcs_budget *budget);
uint64_t tcs_budget_used(tcs_budget *budget, tcs_memory_kind kind);
/* Bytes left of the total, and of the share for voxels. */
uint64_t tcs_budget_left(tcs_budget *budget);
uint64_t tcs_budget_left_for_voxels(tcs_budget *budget);
/* Asks the holders of caches and idle volumes to free memory until `bytes` are left. Keeps `spare` (a volume in use, or
 * NULL). False: there is not enough to free, and nothing was freed. True: the memory is free now, or will be once the
 * render thread has run the tasks queued so far. I/O thread. */
bool tcs_budget_ask(tcs_budget *budget, uint64_t bytes, const void *spare);
/* Sets the callback of tcs_budget_ask(). */
typedef bool (*tcs_give_fn)(void *user, uint64_t bytes, const void *spare);
void tcs_budget_when_asked(tcs_budget *budget, tcs_give_fn give, void *user);

/* Whether voxels of this many bytes could be reserved now. */
bool tcs_budget_fits(tcs_budget *budget, uint64_t bytes);

/* Wraps `bytes` (g_malloc'ed, ownership taken) and counts their size until the last reference is gone, on whichever
 * thread. */
GBytes *tcs_budget_bytes(tcs_budget *budget, tcs_memory_kind kind, void *bytes, size_t size);

/* Sets TC_ERROR_BUSY (503): "the memory is used up: loads need 30 MiB more; in use are volumes 180, caches 12 of 200
 * MiB; ...". `kind` was refused `more` bytes. */
void tcs_budget_refuse(tcs_budget *budget, tcs_memory_kind kind, uint64_t more, GError **error);

#endif
