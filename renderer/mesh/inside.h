/* The first pass of extraction: on which side of the surface each voxel is, a bit per voxel. Private to mesh/. */
#ifndef TC_MESH_INSIDE_H
#define TC_MESH_INSIDE_H

#include "renderer/base/error.h"
#include "renderer/base/pool.h"
#include "renderer/skip/skip.h"

typedef uint64_t tc_side_word; /* 64 voxels of a row */

enum { TC_SIDE_MIXED, TC_SIDE_OUTSIDE, TC_SIDE_INSIDE };

typedef struct tc_inside {
  tc_side_word *bits; /* [z][y][words]: 1 inside; bits beyond the row repeat its last voxel */
  uint8_t *sides;     /* [z][y]: side of all voxels of a row */
} tc_inside;

/* Inside: turn * voxel >= level; turn is 1 or -1. Voxels of blocks that are wholly on one side are not read; blocks: of the
 * volume, complete, or NULL. False: TC_ERROR_MEMORY, or the pool was halted; tc_inside_end() is called on either. */
bool tc_inside_find(tc_inside *inside, const tc_volume *volume, float turn, float level, const tc_minmax *blocks, tc_pool *pool,
                    GError **error);
void tc_inside_end(tc_inside *inside);

#endif
