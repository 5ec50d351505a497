/* Minimum and maximum of each fine box (two cells wide) in 8 bits. Empty-space skipping tests them against any transfer
 * function and does not read the voxels again.
 *
 * Values are binned: 8-bit voxels are their own bins; others share 256 bins, half of them equally wide, half equally
 * full, so that a bin is narrow where many voxels are. A bin is empty if all of its values lie in an empty range
 * (skip/empty_ranges.h), so that rounding to bins loses only the bin that holds a knot. Two bytes stand for eight
 * voxels: a quarter of the bytes of an 8-bit volume, an eighth of a 16-bit one. */
#ifndef TC_SKIP_FINE_H
#define TC_SKIP_FINE_H

#include "renderer/skip/skip.h"

#define TC_FINE_PAD 16 /* readable bytes behind each plane */

typedef struct tc_fine {
  tc_minmax grid;        /* of blocks as wide as a fine box; its pairs are not kept */
  uint8_t *least, *most; /* [blocks z][blocks y][blocks x]: bins of the minima and maxima */
  uint8_t *bins; /* [levels] bin of each level; levels are all values of an 8- or 16-bit type, or 65,536 steps of a
                    float's range */
  int levels;
  double lo, scale; /* level = (voxel - lo) * scale */
  size_t bytes;
  double build_ms;
} tc_fine;

/* Fine boxes are two cells wide, or half of a block that is wider than usual; wider where they would take more than
 * most_bytes. NULL with TC_ERROR_MEMORY. */
tc_fine *tc_fine_begin(const tc_volume *volume, int block, int reach, size_t most_bytes, GError **error);
/* Continues the build to its end (true; at once if finished before). False: the pool was halted, or TC_ERROR_MEMORY. */
bool tc_fine_go_on(tc_fine *fine, const tc_volume *volume, tc_pool *pool, GError **error);
void tc_fine_free(tc_fine *fine); /* NULL is fine */

/* The empty ranges under a support as intervals of bins: a fine box is empty if one of them holds its minimum and its
 * maximum. */
#define TC_FINE_RANGES 8
typedef struct tc_fine_ranges {
  int count;
  uint8_t first[TC_FINE_RANGES], last[TC_FINE_RANGES];
} tc_fine_ranges;
bool tc_fine_find_ranges(const tc_fine *fine, const tc_support *support, tc_fine_ranges *ranges, GError **error);

#endif
