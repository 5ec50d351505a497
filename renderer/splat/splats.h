/* What is drawn of a voxel model: its surface voxels, in bricks of 16x16x16 voxels, four bytes each.
 *
 * A splat is a voxel with a free neighbour (of six). Its word holds the place in the brick (x, y, z: 4 bits each from
 * bit 0), the faces on which it is free (6 bits from bit 12: -x +x -y +y -z +z) and the outward normal in LPS (an
 * octahedral map of 7 + 7 bits from bit 18; all set: none, of a voxel inside). A fifth byte, the inset, is 0 where
 * nothing more is known; else 1 + 254 times the distance in voxels from the voxel's centre to the surface along the
 * normal. A voxel that is free on opposite faces is thin: its inset is a tc_splat_thin, and from bit 0 its thickness in
 * 63rds of a usual kernel's. A voxel without a free face is no splat: it is part of the object's inside, which nobody
 * sees; nor is a splat seen from an eye that is on the filled side of all its free faces. */
#ifndef TC_SPLAT_SPLATS_H
#define TC_SPLAT_SPLATS_H

#include "renderer/scene/scene.h"
#include "renderer/splat/vmd.h"

#define TC_SPLAT_BRICK 16        /* voxels along an edge */
#define TC_SPLAT_PAD 16          /* words that may be read after the last */
#define TC_SPLAT_LONG 1.3        /* half length of a line's kernel over a usual kernel's */
#define TC_SPLAT_MOST (1u << 24) /* splats of a model: sums over any pixel stay below 2^31 */

/* In bits 6 and 7 of a thin voxel's inset: what its filled neighbours (of 26) form. A line's normal is its direction,
 * an end's too; a dot has none. */
typedef enum tc_splat_thin { TC_SPLAT_SHEET, TC_SPLAT_LINE, TC_SPLAT_END, TC_SPLAT_DOT } tc_splat_thin;

typedef struct tc_splat_brick {
  int16_t at[3];  /* in bricks */
  uint8_t faces;  /* of any of its splats */
  uint8_t cap;    /* its splats are a cut's: clipping left them */
  uint32_t first; /* of its splats; they end where the next brick's begin */
} tc_splat_brick;

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
