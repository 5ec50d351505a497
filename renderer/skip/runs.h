/* Empty runs: intervals of values in which every classification finds nothing (tc_support), as sets with one bit per
 * run. Voxels whose sets share a bit all lie in one empty run, so that nothing interpolated between them is visible.
 * From the ninth run on, values count as visible. For an isosurface, the two runs are the values below it and above. */
#ifndef TC_SKIP_RUNS_H
#define TC_SKIP_RUNS_H

#include "renderer/skip/skip.h"

typedef struct tc_runs {
  tc_voxel_type type;
  uint8_t *voxels;    /* sets of all values of an 8- or 16-bit type, from the least on; NULL for floats */
  uint8_t *nodes;     /* [last_node + 1]: sets of the values between a node and the next; NULL for an isosurface */
  int last_node;
  double lo, hi;      /* values of the first and the last node; for an isosurface tc_support's */
  double scale;       /* node = (voxel - lo) * scale */
} tc_runs;

bool tc_runs_init(tc_runs *runs, const tc_support *support, tc_voxel_type type, GError **error);
void tc_runs_finish(tc_runs *runs);

/* The set of one value; the sets of `count` voxels from `first` on. */
uint8_t tc_runs_set(const tc_runs *runs, double voxel);
void tc_runs_read(const tc_runs *runs, const void *voxels, size_t first, int count, uint8_t *sets);

#endif
