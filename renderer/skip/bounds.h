/* Empty-space skipping for projections (mip, minip): upper bounds of the field around each block. A ray skips intervals
 * of samples that cannot raise its maximum.
 *
 * A bound is a level of one byte: 0 at grey's floor or below, 254 at its stop, linear between, rounded up; 255
 * above. Blocks are those of the acceleration grid (tc_minmax). A block's level covers the block and its 26
 * neighbours, hence every point within a block's width of any point in the block: one look-up, in the middle, serves a
 * whole interval of samples. A sample is less than floor + level / scale, including the rounding of interpolation (a
 * block of one value is interpolated exactly). Skipping therefore changes no bit, and a skipped interval contains no
 * sample equal to the maximum. MinIP negates the voxels (raycast/projection.h); its bounds come from the blocks'
 * minima. */
#ifndef TC_BOUNDS_H
#define TC_BOUNDS_H

#include "renderer/raycast/projection.h"
#include "renderer/raycast/rays.h"
#include "renderer/skip/skip.h"

typedef struct tc_bounds {
  int block, reach, blocks[3];
  uint8_t *levels; /* [blocks z][blocks y][blocks x], then at least 4 readable bytes */
  float scale;     /* levels per unit of w */
  tc_grey grey;    /* the window it was built for */
  uint64_t serial; /* unique in the process; keys copies on a GPU */
  size_t bytes;
  double build_ms;
} tc_bounds;

/* The caller frees. NULL with TC_ERROR_MEMORY or the halt's error; a halted build starts anew. */
tc_bounds *tc_bounds_build(const tc_minmax *minmax, const tc_grey *grey, tc_pool *pool, GError **error);
void tc_bounds_free(tc_bounds *bounds); /* NULL is fine */

/* Number of consecutive samples that lie within a block's width of the middle sample along every axis; at least 1. */
int tc_bounds_interval(const tc_bounds *bounds, const tc_rays *rays);

#endif
