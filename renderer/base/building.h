/* What a frame waits for while it is built, for who asks from another thread. */
#ifndef TC_RENDERER_BUILDING_H
#define TC_RENDERER_BUILDING_H

#include <stdatomic.h>

/* The renderer writes, any thread reads. */
typedef struct tc_building {
  atomic_int resource; /* tc_resource (plan/plan.h) + 1; 0: nothing is built */
  atomic_int permille; /* of it, where its kind knows (mesh); else 0 */
} tc_building;

/* A part of what is built: from `from` to `to` of the whole. */
typedef struct tc_share {
  atomic_int *permille; /* NULL: nobody asks */
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
