/* Distance map: for each block of the acceleration grid, the Chebyshev distance in blocks to the nearest occupied block
 * (0 in an occupied block; the outside counts as empty). A ray in a block of distance D may leap across the cube of
 * blocks up to D - 1 away (Deakin and Knackstedt, Efficient ray casting of volumetric images using distance maps for
 * empty space skipping, Computational Visual Media 6, 2020). */
#ifndef TC_DISTANCE_MAP_H
#define TC_DISTANCE_MAP_H

#include "renderer/skip/skip.h"

/* The distance map of an acceleration grid under one support. */
typedef struct tc_distance_map {
  int block, reach, blocks[3];
  uint8_t *distance;  /* [blocks z][blocks y][blocks x], then at least 4 readable bytes; 254 means 254 or more */
  uint8_t *farthest;  /* [blocks z]: the largest distance in a layer */
  int swept;          /* layers of blocks that were computed, not copied from an earlier map */
  double empty_share; /* share of the blocks that are empty */
  uint64_t volume;    /* serial of the volume */
  uint64_t support;   /* serial of the support */
  size_t bytes;
  double build_ms;
} tc_distance_map;

/* before: NULL, or an earlier map of the same grid, from which unaffected layers are copied; the result is the same.
 * The caller frees. NULL with TC_ERROR_MEMORY or the halt's error; a halted build starts anew. */
tc_distance_map *tc_distance_map_build(const tc_minmax *minmax, const tc_support *support, const tc_distance_map *before, tc_pool *pool,
                       GError **error);
void tc_distance_map_free(tc_distance_map *map); /* NULL is fine */

#endif
