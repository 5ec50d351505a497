/* Which values show nothing: the runs of values between which no classification finds anything (tc_support), as sets
 * with one bit a run. Voxels are all in one run, so that nothing interpolated between them shows, when their sets have
 * a bit in common. The ninth run and further ones are taken to show something. Of a surface the runs are what is below
 * it and what is above. */
#ifndef TC_SKIP_RUNS_H
#define TC_SKIP_RUNS_H

#include "renderer/skip/skip.h"

typedef struct tc_runs {
  tc_voxel_type type;
  uint8_t *voxels;    /* sets of all values of an 8- or 16-bit type, from its least on; NULL for floats */
  uint8_t *nodes;     /* [last_node + 1]: sets of the values from a node to the next; NULL for a surface */
  uint32_t *before;   /* [last_node + 2]: how many nodes before this one are in a run; NULL for a surface */
  int last_node;
  double lo, hi;      /* values of the first and the last node, or of the surface (tc_support) */
  double scale;       /* node = (voxel - lo) * scale */
  double zero_below, zero_above; /* a lookup between two nodes that are both below, or both above, is exactly zero */
} tc_runs;

bool tc_runs_init(tc_runs *runs, const tc_support *support, tc_voxel_type type, GError **error);
void tc_runs_finish(tc_runs *runs);

/* The set of a value; of `count` voxels from `first` on. */
uint8_t tc_runs_set(const tc_runs *runs, double voxel);
void tc_runs_read(const tc_runs *runs, const void *voxels, size_t first, int count, uint8_t *sets);

/* No value from lo to hi is in a run. Not of a surface. */
bool tc_runs_miss(const tc_runs *runs, double lo, double hi);

#endif
