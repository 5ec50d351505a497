/* Empty ranges: intervals of values that are invisible under every classification (tc_support), as sets with one bit
 * per range. If the sets of several voxels share a bit, all lie in one empty range, and no value interpolated between
 * them is visible. From the ninth range on, values count as visible. For an isosurface, the two ranges are the values
 * below it and above it. */
#ifndef TC_SKIP_EMPTY_RANGES_H
#define TC_SKIP_EMPTY_RANGES_H

#include "renderer/skip/skip.h"

typedef struct tc_empty_ranges {
  tc_voxel_type type;
  uint8_t *voxels;    /* sets of all values of an 8- or 16-bit type, from the smallest; NULL for floats */
  uint8_t *nodes;     /* [last_node + 1]: sets of the values between a node and the next; NULL for an isosurface */
  int last_node;
  double lo, hi;      /* values of the first and the last node; for an isosurface those of tc_support */
  double scale;       /* node = (voxel - lo) * scale */
} tc_empty_ranges;

bool tc_empty_ranges_init(tc_empty_ranges *ranges, const tc_support *support, tc_voxel_type type, GError **error);
void tc_empty_ranges_finish(tc_empty_ranges *ranges);

/* The set of one value; the sets of voxels first .. first + count - 1. */
uint8_t tc_empty_ranges_set(const tc_empty_ranges *ranges, double voxel);
void tc_empty_ranges_read(const tc_empty_ranges *ranges, const void *voxels, size_t first, int count, uint8_t *sets);

#endif
