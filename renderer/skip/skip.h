/* Space leaping (paper 001): what is empty under the current transfer function, and how far a ray may go.
 *
 * The volume's cells are grouped into cubic blocks. A block's minimum and maximum are over its cells' corners, so one
 * voxel of skirt on its far sides is included: every interpolated value inside lies between them (a cubic filter
 * reaches a voxel further on every side). A block is empty when no entry that a lookup between two such values can
 * touch, in any classification's table, is other than zero; since neighbouring blocks share their face's voxels, the
 * union of connected empty blocks is one value interval, and segments between samples in it are zero too. The distance
 * map holds, per block, the Chebyshev distance in blocks to the nearest block that is not empty (0 in such a block
 * itself; the outside counts as empty): a ray in a block of distance D may pass the cube of blocks D-1 around it
 * (Deakin and Knackstedt, Efficient ray casting of volumetric images using distance maps for empty space skipping,
 * Computational Visual Media 6, 2020). What is leapt contributes exactly zero, so leaping changes no bit of the
 * picture. */
#ifndef TC_SKIP_H
#define TC_SKIP_H

#include "renderer/classify/classify.h"
#include "renderer/pool.h"
#include "renderer/volume/volume.h"

/* Voxels a block is wide unless a scene says otherwise: small blocks fit better around what is there, and at 5 the
 * structure (minimum, maximum, distance) still stays under 3 % of the voxel bytes. */
#define TC_SKIP_BLOCK 5

/* The block width for a scene's skipping.block: 0 takes the default, others are clamped to 2..128. */
int tc_skip_block(int block);

/* How many voxels beyond a cell's corners a filter reaches. */
int tc_skip_reach(tc_filter filter);

/* Minima and maxima per block, in the volume's voxel type. */
typedef struct tc_minmax {
  int block;      /* voxels a block is wide */
  int reach;      /* voxels beyond the cells' corners that are counted too */
  int blocks[3];
  void *pairs;    /* [blocks z][blocks y][blocks x][2]: minimum, maximum */
  tc_voxel_type type;
  int done;       /* rows of blocks, from the first on: in the making while not all are */
  size_t bytes;
  double build_ms;
} tc_minmax;

tc_minmax *tc_minmax_begin(const tc_volume *volume, int block, int reach, GError **error);
/* Goes on until it is made: true, at once for one that is. False: the pool's halt, or TC_ERROR_MEMORY; it may be called
 * again. */
bool tc_minmax_go_on(tc_minmax *minmax, const tc_volume *volume, tc_pool *pool, GError **error);
/* All at once. */
tc_minmax *tc_minmax_build(const tc_volume *volume, int block, int reach, tc_pool *pool, GError **error);
void tc_minmax_free(tc_minmax *minmax); /* NULL is fine */
double tc_minmax_value(const tc_minmax *minmax, size_t i); /* pairs[i] */

/* Where along a table's nodes a transfer function shows something at all: its extinction alone decides, so that neither
 * colours nor the length of a segment matter. */
typedef struct tc_support {
  int n;          /* nodes, as the table's */
  double lo, hi;  /* voxel values of nodes 0 and n-1 */
  uint32_t *used; /* [n + 4]: how many of the node intervals before node j hold something, within or at an end; NULL for a
                     surface: what shows lies between lo and hi */
  uint64_t serial; /* unique in the process */
  size_t bytes;
  double build_ms;
} tc_support;

/* For the nodes of a table with these parameters; its step and its colours are not read. */
tc_support *tc_support_build(const tc_table_params *params, GError **error);
/* Of an isosurface: blocks with all voxels below lo, or all above hi, are empty (raycast/surface.h). */
tc_support *tc_support_surface(double lo, double hi, GError **error);
void tc_support_free(tc_support *support); /* NULL is fine */

/* A lookup between two nodes that are both below *below, or both above *above, is exactly zero. */
void tc_support_zones(const tc_support *support, double *below, double *above);

/* Distances under one support. */
typedef struct tc_leap {
  int block, reach, blocks[3];
  uint8_t *distance;  /* [blocks z][blocks y][blocks x], then at least 4 readable bytes; 254 stands for that and more */
  uint8_t *farthest;  /* [blocks z]: the greatest distance in a layer */
  int swept;          /* layers of blocks whose distances were worked out and not copied */
  double empty_share; /* of the blocks */
  uint64_t volume;    /* serial of the volume it is kept for */
  uint64_t support;   /* serial of what it was built with */
  size_t bytes;
  double build_ms;
} tc_leap;

/* before: NULL, or an earlier map of the same blocks: only the layers that what changed since can reach are worked out
 * again, and the result is the same. NULL with TC_ERROR_MEMORY, or what the pool's halt says: nothing is kept then. */
tc_leap *tc_leap_build(const tc_minmax *minmax, const tc_support *support, const tc_leap *before, tc_pool *pool,
                       GError **error);
void tc_leap_free(tc_leap *leap); /* NULL is fine */

/* False when the transfer function is nowhere zero between two values: then nothing can be empty and no structure is
 * built. */
bool tc_skip_possible(const tc_transfer_function *tf, double value_min, double value_max);

#endif
