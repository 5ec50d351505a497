/* Splats: the surface voxels of a voxel model, in bricks of 16x16x16 voxels, five bytes each.
 *
 * A splat is a voxel with at least one free neighbour (of six). Its 32-bit word holds the position in the brick (x, y,
 * z: 4 bits each from bit 0), the free faces (6 bits from bit 12: -x +x -y +y -z +z) and the outward normal in LPS
 * (octahedral map of 7 + 7 bits from bit 18; all bits set: no normal, an interior voxel).
 *
 * The fifth byte, the inset, is 1 + 254 times the distance (voxels) from the voxel's centre to the surface along the
 * normal; 0: unknown. Thin voxels, which are free on opposite faces, store instead a tc_splat_thin in bits 6 and 7 and,
 * in bits 0 to 5, their thickness as 63rds of an ordinary kernel's.
 *
 * Interior voxels are no splats, since no eye sees them. A splat is invisible, too, to an eye on the filled side of all
 * its free faces. */
#ifndef TC_SPLAT_SPLATS_H
#define TC_SPLAT_SPLATS_H

#include "renderer/scene/scene.h"
#include "renderer/splat/vmd.h"

#define TC_SPLAT_BRICK 16        /* voxels along an edge */
#define TC_SPLAT_PAD 16          /* words that may be read after the last */
#define TC_SPLAT_LONG 1.3        /* half length of a line's kernel over a usual kernel's; voxels that an end goes on, at most */
#define TC_SPLAT_MOST ((1u << 24) - 1) /* splats of a model: sums over any pixel stay below 2^31 */

/* In bits 6 and 7 of a thin voxel's inset: what its filled neighbours (of 26) form. A line's normal is its direction,
 * an end's too, outwards; a dot has none. An end has in bits 0 to 2 how far on it ends, in sevenths of TC_SPLAT_LONG
 * voxels, and in bits 3 to 5 its thickness, from 0.3 on in tenths. */
typedef enum tc_splat_thin { TC_SPLAT_SHEET, TC_SPLAT_LINE, TC_SPLAT_END, TC_SPLAT_DOT } tc_splat_thin;

/* Eight bytes, which few splats share where an object is thin. */
typedef struct tc_splat_brick {
  uint64_t first : 24; /* of its splats, which are sorted by their free faces; they end where the next brick's begin */
  uint64_t x : 11, y : 11, z : 11; /* in bricks: those of TC_VMD_SIDE voxels */
  uint64_t faces : 6;              /* of any of its splats */
  uint64_t cap : 1;                /* its splats are a cut's: clipping left them */
} tc_splat_brick;

/* A brick's place along an index axis, in bricks. */
static inline int tc_splat_brick_at(const tc_splat_brick *brick, int axis) {
  return (int)(axis == 0 ? brick->x : axis == 1 ? brick->y : brick->z);
}

typedef struct tc_splats {
  tc_splat_brick *bricks; /* [n_bricks + 1] */
  uint32_t *words;        /* [n + TC_SPLAT_PAD] */
  uint8_t *insets;        /* the same */
  uint32_t n, n_bricks;
  size_t bytes;
  uint64_t serial; /* of no other */
} tc_splats;

/* Normals of a model's voxels, any length, outward, in LPS, and how far away along them the surface is, in voxels
 * (negative: unknown); from any thread. */
typedef struct tc_splat_normals {
  double (*of)(const void *user, int x, int y, int z, double normal[3]);
  const void *user;
  /* How far from a voxel along a direction (a unit vector of index coordinates) the surface is, in voxels, at
   * most `most`. NULL: half a voxel. */
  double (*end)(const void *user, const int at[3], const double direction[3], double most);
} tc_splat_normals;

/* normals.of NULL: the model's attribute "normal", or else what is filled within two voxels, which gives unknown
 * distances, too. everything: voxels of the inside too, with no faces, for comparison. pool may be NULL.
 * TC_ERROR_LIMIT: over TC_SPLAT_MOST; _MEMORY; or what the halt says. */
tc_splats *tc_splats_build(const tc_vmd *model, tc_splat_normals normals, bool everything, tc_pool *pool,
                           GError **error);
/* The voxels that planes (index coordinates, what is kept has planes[i] . (position, 1) >= 0) lay open. */
tc_splats *tc_splats_cut(const tc_vmd *model, const double planes[][4], int n_planes, const tc_halt *halt,
                         GError **error);
void tc_splats_free(tc_splats *splats); /* NULL is fine */

#endif
