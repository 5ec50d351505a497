/* Empty-space skipping: the acceleration grid (minimum and maximum per block), and which values are empty under a
 * transfer function (support).
 *
 * The acceleration grid groups the volume's cells into cubic blocks. A block's minimum and maximum are over its cells'
 * corners, one voxel beyond its far faces included (a cubic filter reaches a voxel further on every side), so every
 * interpolated value inside lies between them. A block is empty when all table entries, of any classification, that a
 * look-up between two such values can touch are zero. Neighbouring blocks share the voxels of their face; connected
 * empty blocks therefore cover one interval of values, and segments between samples in them are zero too.
 *
 * Skipped segments contribute exactly zero, so empty-space skipping changes no bit of the picture. What is skipped is
 * found in the distance map (distance_map.h), boxes (boxes.h) or bounds (bounds.h) made from the grid. */
#ifndef TC_SKIP_H
#define TC_SKIP_H

#include "renderer/classify/preintegration.h"
#include "renderer/base/pool.h"
#include "renderer/volume/volume.h"

/* Default width of a block in voxels. Small blocks fit more tightly around what is visible; at 5, minimum, maximum
 * and distance still take less than 3 % of the voxel bytes. */
#define TC_SKIP_BLOCK 5

/* The block width for a scene's skipping.block: 0 is the default, others are clamped to 2..128. */
int tc_skip_block(int block);

/* How many voxels a filter reaches beyond a cell's corners. */
int tc_skip_reach(tc_filter filter);

/* The acceleration grid: minimum and maximum per block, in the volume's voxel type. */
typedef struct tc_minmax {
  int block;      /* width of a block, voxels */
  int reach;      /* tc_skip_reach() */
  int blocks[3];
  void *pairs;    /* [blocks z][blocks y][blocks x][2]: minimum, maximum */
  tc_voxel_type type;
  int done;       /* finished rows of blocks; the grid is complete when all are */
  size_t bytes;
  double build_ms;
} tc_minmax;

tc_minmax *tc_minmax_begin(const tc_volume *volume, int block, int reach, GError **error);
/* Builds on until the grid is complete: true, at once if it already is. False: the pool's halt, or TC_ERROR_MEMORY;
 * may be called again. */
bool tc_minmax_go_on(tc_minmax *minmax, const tc_volume *volume, tc_pool *pool, GError **error);
tc_minmax *tc_minmax_build(const tc_volume *volume, int block, int reach, tc_pool *pool, GError **error);
void tc_minmax_free(tc_minmax *minmax); /* NULL is fine */

/* Support of a transfer function: at which nodes of the value axis its extinction is not zero. Colours and the
 * length of a segment do not matter. */
typedef struct tc_support {
  int n;          /* nodes, as the table's */
  double lo, hi;  /* voxel values of nodes 0 and n-1 */
  uint32_t *used; /* [n + 4]: how many node intervals before node j are visible, inside or at an end; NULL for an isosurface: visible
                     values lie between lo and hi */
  uint64_t serial; /* unique in the process */
  size_t bytes;
  double build_ms;
} tc_support;

/* On the nodes of a table with these parameters, whose step and colours are not read. */
tc_support *tc_support_build(const tc_table_params *params, GError **error);
/* For an isosurface: blocks with all voxels below lo, or all above hi, are empty (raycast/isosurface.h). */
tc_support *tc_support_surface(double lo, double hi, GError **error);
void tc_support_free(tc_support *support); /* NULL is fine */

/* A lookup between two nodes that are both below *below, or both above *above, is exactly zero, in tables with these
 * parameters. */
void tc_support_zones(const tc_table_params *params, double *below, double *above);

/* False if the transfer function is nowhere zero between two values: nothing can be empty then. */
bool tc_skip_possible(const tc_transfer_function *tf, double value_min, double value_max);

#endif
