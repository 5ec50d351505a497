/* Space leaping (paper 001): what is empty under the current transfer function, and how far a ray may go.
 *
 * The volume's cells are grouped into cubic blocks. A block's minimum and maximum are over its cells' corners, so
 * one voxel of skirt on its far sides is included: every interpolated value inside lies between them. A block is empty when no
 * table entry that a lookup between two such values can touch is other than zero; since neighbouring blocks share their
 * face's voxels, the union of connected empty blocks is one value interval, and segments between samples in it are
 * zero too. The distance map holds, per block, the Chebyshev distance in blocks to the nearest block that is not empty (0 in such
 * a block itself; the outside counts as empty): a ray in a block of distance D may pass the cube of blocks D-1 around it
 * (Deakin and Knackstedt, Efficient ray casting of volumetric images using distance maps for empty space skipping,
 * Computational Visual Media 6, 2020). What is leapt contributes exactly zero, so leaping changes no bit of the picture. */
#ifndef TC_SKIP_H
#define TC_SKIP_H

#include "renderer/classify/classify.h"
#include "renderer/pool.h"
#include "renderer/volume/volume.h"

#define TC_SKIP_BLOCK_LOG2 3 /* 8 voxels; measured best of 4 to 32 on CT heads and vessels */

/* log2 of the block edge for a scene's skipping.block: 0 takes the default, others round up to a power of two, 4 to 128. */
int tc_skip_block_log2(int block);

/* Minima and maxima per block, in the volume's voxel type. */
typedef struct tc_minmax {
  int log2;       /* block edge = 1 << log2 voxels */
  int blocks[3];
  void *pairs;    /* [blocks z][blocks y][blocks x][2]: minimum, maximum */
  tc_voxel_type type;
  size_t bytes;
  double build_ms;
} tc_minmax;

tc_minmax *tc_minmax_build(const tc_volume *volume, int log2, tc_pool *pool, GError **error);
void tc_minmax_free(tc_minmax *minmax); /* NULL is fine */

/* Distances under one table. */
typedef struct tc_leap {
  int log2, blocks[3];
  uint8_t *distance;  /* [blocks z][blocks y][blocks x], then at least 4 readable bytes */
  double empty_share; /* of the blocks */
  size_t bytes;
  double build_ms;
} tc_leap;

tc_leap *tc_leap_build(const tc_minmax *minmax, const tc_table *table, GError **error);
void tc_leap_free(tc_leap *leap); /* NULL is fine */

/* False when the transfer function is nowhere zero between two values: then nothing can be empty and no structure is built. */
bool tc_skip_possible(const tc_transfer_function *tf, double value_min, double value_max);

#endif
