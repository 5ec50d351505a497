/* Empty-space skipping: the acceleration grid (minimum and maximum per block), and the values that are empty under a
 * transfer function (support).
 *
 * The acceleration grid groups the volume's cells into cubic blocks. A block's minimum and maximum are over its cells'
 * corners, including one voxel beyond its far faces (a cubic filter reaches one voxel further on every side), so every
 * interpolated value inside lies between them. A block is empty if all table entries, of any classification, that a
 * look-up between two such values can read are zero. Neighbouring blocks share the voxels of their common face;
 * connected empty blocks therefore lie in one interval of values, and segments between samples in them are zero too.
 *
 * Skipped segments contribute exactly zero, so empty-space skipping changes no bit of the picture. Rays find empty
 * space by the distance map (distance_map.h), boxes (boxes.h) or bounds (bounds.h) made from the grid. */
#ifndef TC_SKIP_H
#define TC_SKIP_H

#include "renderer/classify/preintegration.h"
#include "renderer/base/pool.h"
#include "renderer/volume/volume.h"

/* Default width of a block in voxels. Small blocks fit more tightly around what is visible; at 5, minimum, maximum
 * and distance still take less than 3 % of the voxel bytes. */
#define TC_SKIP_BLOCK 5
#define TC_SKIP_BLOCK_BOUNDS 4 /* of projections on the cpu: minimum, maximum and level take less than 5 % */

/* The block width for a scene's skipping.block: 0 is the default, others are clamped to 2..128. */
int tc_skip_block(int block);

/* Number of voxels that a filter reads beyond a cell's corners. */
int tc_skip_reach(tc_filter filter);

/* The acceleration grid: minimum and maximum per block, in the volume's voxel type. */
typedef struct tc_minmax {
  int block;      /* width of a block, voxels */
  int reach;      /* tc_skip_reach() */
  int blocks[3];
  void *pairs;    /* [blocks z][blocks y][blocks x][2]: minimum, maximum */
  tc_voxel_type type;
  int done;       /* finished tasks; the grid is complete when all are */
  size_t bytes;
  double build_ms;
} tc_minmax;

tc_minmax *tc_minmax_begin(const tc_volume *volume, int block, int reach, GError **error);
/* Continues the build; true once the grid is complete. False: the pool was halted (call again), or TC_ERROR_MEMORY. */
bool tc_minmax_go_on(tc_minmax *minmax, const tc_volume *volume, tc_pool *pool, GError **error);
tc_minmax *tc_minmax_build(const tc_volume *volume, int block, int reach, tc_pool *pool, GError **error);
void tc_minmax_free(tc_minmax *minmax); /* NULL is fine */

/* Support of a transfer function: the nodes of the value axis at which extinction is not zero. Independent of colours
 * and of the length of a segment. */
typedef struct tc_support {
  int n;          /* nodes, the same as the table's */
  double lo, hi;  /* voxel values of nodes 0 and n-1; for an isosurface visible values lie between lo and hi */
  uint32_t *used; /* [n + 4]: number of node intervals before node j that are visible inside or at an end (a prefix
                     sum); NULL for an isosurface */
  uint64_t serial; /* unique in the process */
  size_t bytes;
  double build_ms;
} tc_support;

/* The support on the nodes of a table with these parameters; step and colours are not read. The caller frees. NULL with
 * TC_ERROR_MEMORY. */
tc_support *tc_support_build(const tc_table_params *params, GError **error);
/* The support of an isosurface: blocks with all voxels below lo, or all above hi, are empty (raycast/isosurface.h). */
tc_support *tc_support_surface(double lo, double hi, GError **error);
void tc_support_free(tc_support *support); /* NULL is fine */

/* Finds the outer zones of zero extinction in tables with these parameters: a look-up between two nodes that are both
 * below *below, or both above *above, is exactly zero. */
void tc_support_zones(const tc_table_params *params, double *below, double *above);

/* False if the transfer function is nowhere zero between two values, so that nothing can be empty. */
bool tc_skip_possible(const tc_transfer_function *tf, double value_min, double value_max);

#endif
