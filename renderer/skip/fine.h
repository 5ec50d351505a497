/* Minimum and maximum of each fine box (two cells wide) in 8 bits. Empty-space skipping tests them against a new
 * transfer function without reading the voxels again.
 *
 * Values are binned: an 8-bit value is its own bin; other types have 256 bins, a compromise between equal width and
 * equal number of voxels, so that bins are narrow where voxels are frequent. A bin is empty if all of its values lie in
 * one empty range (skip/empty_ranges.h), so binning loses only the bin that contains a knot. Two bytes per eight
 * voxels: a quarter of the bytes of an 8-bit volume, an eighth of a 16-bit one. The least and the most of each group of boxes
 * along x tell that a group is empty without reading its boxes. */
#ifndef TC_SKIP_FINE_H
#define TC_SKIP_FINE_H

#include "renderer/skip/skip.h"

#define TC_FINE_PAD 16 /* readable bytes behind each plane */
#define TC_FINE_GROUP 48

typedef struct tc_fine {
  tc_minmax grid;        /* acceleration grid with blocks of the size of a fine box; its pairs are not kept */
  uint8_t *least, *most; /* [blocks z][blocks y][blocks x]: bins of the minima and maxima */
  uint8_t *group_least, *group_most; /* [blocks z][blocks y][groups]: the least and the most of each group along x */
  int groups; /* of a row, TC_FINE_GROUP fine boxes each; the last may have fewer */
  uint8_t *bins; /* [levels] bin of each level; levels are all values of an 8- or 16-bit type, or 65,536 steps of a
                    float's range */
  int levels;
  double lo, scale; /* level = (voxel - lo) * scale */
  size_t bytes;
  double build_ms;
} tc_fine;

/* Starts a build; the caller frees. Fine boxes are two cells wide, or half a block if blocks are wider than the
 * default; wider still if they would take more than most_bytes. NULL with TC_ERROR_MEMORY. */
tc_fine *tc_fine_begin(const tc_volume *volume, int block, int reach, size_t most_bytes, GError **error);
/* Continues the build; true once complete. False: the pool was halted (call again), or TC_ERROR_MEMORY. */
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
