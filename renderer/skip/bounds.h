/* Skipping for the projections: how large the field may be around each block, so that a ray leaves out what cannot
 * raise its maximum.
 *
 * A bound is a level of one byte: 0 at grey's floor or below, 254 at its stop, linear between, rounded up; 255 above.
 * Blocks are those of tc_minmax; the level of a block is over it and its 26 neighbours, so that it holds for every
 * place within a block's width of any place in it: one look in the middle serves a whole interval of samples, and no
 * look waits for another. A sample is less than floor + level / scale, rounding of the interpolation included (a
 * block all of one value is interpolated exactly), so that what is skipped changes no bit, and holds no equal either. For minip the voxels are turned
 * (raycast/grey.h) and bounds come from the blocks' minima. */
#ifndef TC_BOUNDS_H
#define TC_BOUNDS_H

#include "renderer/raycast/grey.h"
#include "renderer/raycast/rays.h"
#include "renderer/skip/skip.h"

typedef struct tc_bounds {
  int block, reach, blocks[3];
  uint8_t *levels; /* [blocks z][blocks y][blocks x], then at least 4 readable bytes */
  float scale;     /* levels per unit of w */
  tc_grey grey;    /* what it was built for */
  uint64_t serial; /* unique in the process; keys copies on a GPU */
  size_t bytes;
  double build_ms;
} tc_bounds;

/* NULL with TC_ERROR_MEMORY, or what the pool's halt says: nothing is kept then. */
tc_bounds *tc_bounds_build(const tc_minmax *minmax, const tc_grey *grey, tc_pool *pool, GError **error);
void tc_bounds_free(tc_bounds *bounds); /* NULL is fine */

/* How many samples, a step apart, lie within a block's width of the middle one's place along every axis; at least 1. */
int tc_bounds_interval(const tc_bounds *bounds, const tc_rays *rays);

#endif
