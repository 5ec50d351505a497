/* Progress of the resource that a frame is building, readable from any thread. */
#ifndef TC_RENDERER_BUILDING_H
#define TC_RENDERER_BUILDING_H

#include <stdatomic.h>

/* Written by the renderer, read by any thread. */
typedef struct tc_building {
  atomic_int resource; /* tc_resource (plan/plan.h) + 1; 0: nothing is being built */
  atomic_int permille; /* finished share of the build, 0..1000; stays 0 for kinds that do not report it */
} tc_building;

/* One step of a build: the step covers the range from .. to of the whole, 0..1. */
typedef struct tc_share {
  atomic_int *permille; /* where progress is reported; NULL: not reported */
  double from, to;
} tc_share;

static inline tc_share tc_share_part(const tc_share *whole, double from, double to) {
  const double size = whole->to - whole->from;
  return (tc_share){whole->permille, whole->from + from * size, whole->from + to * size};
}

static inline void tc_share_done(const tc_share *share, double done) {
  if (share->permille)
    atomic_store_explicit(share->permille, (int)(1000 * (share->from + done * (share->to - share->from))), memory_order_relaxed);
}

#endif
