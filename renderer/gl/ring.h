/* Read-back ring: copies results from the GPU tile by tile while later tiles are still computed.
 *
 * Each slot has a buffer the shader writes (device memory), a persistently mapped buffer the result is copied to, a
 * fence, and two GPU clock readings. Order of use: begin -> dispatch -> end, and, oldest first, take -> read -> give.
 * Needs a current context throughout. */
#ifndef TC_GL_RING_H
#define TC_GL_RING_H

#include <stdbool.h>
#include <stddef.h>

#include "renderer/base/error.h"

#define TC_GL_RING_SLOTS 3

typedef struct tc_gl_slot {
  unsigned device, host; /* GL buffer names */
  const void *mapped;    /* [capacity], valid to read between take and give */
  void *fence;           /* GLsync of the copy */
  unsigned clocks[2];    /* GL_TIMESTAMP queries around the work */
  int tile[4];           /* for the caller: x, y, width, height of the dispatched tile in pixels */
} tc_gl_slot;

typedef struct tc_gl_ring {
  tc_gl_slot slots[TC_GL_RING_SLOTS];
  size_t capacity;     /* bytes of each slot's two buffers */
  unsigned head, tail; /* slots in flight: tail .. head - 1, modulo TC_GL_RING_SLOTS */
  bool has_clock;      /* the driver has GL_TIMESTAMP */
} tc_gl_ring;

/* Grows every slot to at least `capacity` bytes; the ring must be idle. A zeroed ring is empty. TC_ERROR_MEMORY. */
bool tc_gl_ring_reserve(tc_gl_ring *ring, size_t capacity, bool has_clock, GError **error);
void tc_gl_ring_clear(tc_gl_ring *ring); /* waits for slots in flight; frees everything */

bool tc_gl_ring_is_full(const tc_gl_ring *ring);
bool tc_gl_ring_is_idle(const tc_gl_ring *ring);

/* The next free slot (the ring is not full); the caller binds slot->device and dispatches. Starts its clock. */
tc_gl_slot *tc_gl_ring_begin(tc_gl_ring *ring);
/* Queues the copy of the slot's first `bytes` behind the dispatch, and the fence behind the copy. */
void tc_gl_ring_end(tc_gl_ring *ring, size_t bytes);

/* Waits for the oldest slot in flight. False: the GPU gave no answer within a minute or was lost. */
const tc_gl_slot *tc_gl_ring_take(tc_gl_ring *ring, GError **error);
/* GPU milliseconds of the taken slot, or -1 without a clock. */
double tc_gl_ring_ms(const tc_gl_ring *ring, const tc_gl_slot *slot);
/* Frees the oldest slot for reuse. */
void tc_gl_ring_give(tc_gl_ring *ring);

#endif
