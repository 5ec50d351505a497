/* Splats: the surface voxels of a voxel model, in bricks of 16x16x16 voxels, five bytes each.
 *
 * A splat is a filled voxel of which at least one of the six neighbours is free. Its 32-bit word holds the position in the brick
 * (x, y, z: 4 bits each from bit 0), the free faces (6 bits from bit 12: -x +x -y +y -z +z) and the outward normal in LPS
 * (octahedral map of 7 + 7 bits from bit 18; all bits set: an interior voxel without a normal).
 *
 * The fifth byte, the inset, is 1 + 254 times the distance in voxels from the voxel's centre to the surface along the normal;
 * 0: unknown. Thin voxels, whose opposite faces are free, store a tc_splat_thin in bits 6 and 7 instead, and in bits 0 to 5
 * their thickness in 63rds of an ordinary kernel's.
 *
 * An object is continued beyond the sides of its grid and clipped there, half a voxel beyond the outermost voxels: at a side of
 * the grid no face is free, and tc_splats_cut() adds the cut face.
 *
 * Interior voxels are no splats, because they are never visible. A splat is visible only if a free face faces the eye or, where
 * voxels are larger than pixels, if its surface does: of a surface seen at a flat angle most voxels have no free face towards
 * the eye. */
#ifndef TC_SPLAT_SPLATS_H
#define TC_SPLAT_SPLATS_H

#include "renderer/scene/scene.h"
#include "renderer/splat/vmd.h"

#define TC_SPLAT_BRICK 16        /* voxels along an edge */
#define TC_SPLAT_PAD 16          /* readable words after the last */
#define TC_SPLAT_MOST_PLANES 18  /* planes that clip an object: TC_MAX_CLIP_PLANES, and the six sides of its grid */
#define TC_SPLAT_LONG 1.3        /* half length of a line's kernel over a ball's radius; largest distance of a line's end from its voxel */
/* Most splats of a model: the sums of a pixel stay below 2^31 from any distance. The bones in 512x512x1000 voxels have two to
 * three million (renderer/NUMERICS.md). */
#define TC_SPLAT_MOST ((1u << 24) - 1)

/* Shape that a thin voxel forms with its filled neighbours (of 26). A line, and the end of a line, store their direction (of an end
 * outwards) in place of the normal; a dot, a single voxel, has none. An end stores in bits 0 to 2 the distance to the line's end,
 * in sevenths of TC_SPLAT_LONG voxels, and in bits 3 to 5 its thickness as (thickness - 0.3) in tenths. */
typedef enum tc_splat_thin { TC_SPLAT_SHEET, TC_SPLAT_LINE, TC_SPLAT_END, TC_SPLAT_DOT } tc_splat_thin;

/* True if two of the faces (6 bits) lie opposite each other. */
static inline bool tc_splat_is_thin(unsigned faces) { return (faces & faces >> 1 & 0x15) != 0; }

/* A brick; its splats are sorted by their free faces. */
typedef struct tc_splat_brick {
  uint32_t first, count; /* of its splats */
  int at[3];             /* in bricks */
  uint8_t faces;         /* free faces of its splats; tc_splats_next() sets all six if there are fewer than 16 splats */
} tc_splat_brick;

/* Bricks are packed and read one after the other, because bricks of thin objects hold few splats. Most take two to four bytes: a
 * byte with the number of splats (bits 0 to 5; 63: the number follows in two bytes) and a tc_splat_step (bits 6 and 7); the
 * bytes of the step; and the faces, if the brick has 16 splats or more. */
typedef struct tc_splats {
  uint8_t *bricks;
  uint32_t *words;   /* [n + TC_SPLAT_PAD] */
  uint8_t *insets;   /* [n + TC_SPLAT_PAD] */
  uint32_t *rims;    /* [n + TC_SPLAT_PAD] of cut faces: the object's surface at the same voxel as its splat's word, with the inset in
                        place of the position (bits 0 to 7; lines and single voxels: 0); 0: none. NULL: these are no cut faces */
  uint32_t n, n_bricks;
  bool cut;          /* these are cut faces */
  uint8_t sides;     /* sides of the grid that the object reaches: bits as for free faces */
  size_t bytes;
  uint64_t serial; /* unique in the process */
} tc_splats;

/* Step from the preceding brick, of which the first is 0, 0, 0: to the next brick along z; further along z (a byte: the distance);
 * along x (a byte) and z (a signed byte); or to any brick (its x, y, z: two bytes each). */
typedef enum tc_splat_step { TC_SPLAT_NEXT, TC_SPLAT_FURTHER, TC_SPLAT_COLUMN, TC_SPLAT_ELSEWHERE } tc_splat_step;

/* Replaces a brick by the next one. Start with a brick of zeros and *from 0; *from counts the bytes read. */
static inline void tc_splats_next(const tc_splats *s, size_t *from, tc_splat_brick *brick) {
  const uint8_t *p = s->bricks + *from;
  const unsigned head = *p++;
  brick->first += brick->count;
  brick->count = head & 63;
  if (brick->count == 63) brick->count = p[0] | (uint32_t)p[1] << 8, p += 2;
  switch ((tc_splat_step)(head >> 6)) {
    case TC_SPLAT_NEXT: brick->at[2]++; break;
    case TC_SPLAT_FURTHER: brick->at[2] += *p++; break;
    case TC_SPLAT_COLUMN: brick->at[0] += p[0], brick->at[2] += (int8_t)p[1], p += 2; break;
    case TC_SPLAT_ELSEWHERE:
      for (int k = 0; k < 3; k++, p += 2) brick->at[k] = p[0] | p[1] << 8;
      break;
  }
  brick->faces = 63;
  if (brick->count >= 16) brick->faces = *p++;
  *from = (size_t)(p - s->bricks);
}

/* Callbacks for a model's surface, called from any thread. `of` sets the outward normal of a voxel in LPS, of any length, and
 * returns the distance along it to the surface in voxels (negative: unknown). */
typedef struct tc_splat_normals {
  double (*of)(const void *user, int x, int y, int z, double normal[3]);
  const void *user;
  /* Distance from a voxel to the surface along a direction (a unit vector of index coordinates), in voxels, at most `most`. NULL:
   * half a voxel. */
  double (*end)(const void *user, const int at[3], const double direction[3], double most);
} tc_splat_normals;

/* Finds the splats of a model. If normals.of is NULL, normals are the model's attribute "normal", or else come from the filled
 * voxels within two voxels; so do unknown distances. everything: interior voxels become splats without faces, for comparison.
 * pool may be NULL. TC_ERROR_LIMIT above TC_SPLAT_MOST, TC_ERROR_MEMORY, TC_ERROR_CANCELLED or _PAUSED by the pool's halt. */
tc_splats *tc_splats_build(const tc_vmd *model, tc_splat_normals normals, bool everything, tc_pool *pool,
                           GError **error);
/* Sets the outward normal (LPS, any length) of a voxel from the 5x5x5 voxels around it. filled: number of filled voxels; sum: minus
 * the sum of their offsets. Returns the distance of the surface in voxels, as if it were a plane. */
double tc_splats_filled_normal(const tc_volume_desc *grid, const int sum[3], int filled, double normal[3]);
/* The cut faces of planes: splats of the voxels that the planes expose. Positions in index coordinates are kept if planes[i] .
 * (position, 1) >= 0 for all planes, at most TC_SPLAT_MOST_PLANES. of: the splats of the whole model. Fails as tc_splats_build(). */
tc_splats *tc_splats_cut(const tc_vmd *model, const tc_splats *of, const double planes[][4], int n_planes, const tc_halt *halt,
                         GError **error);
void tc_splats_free(tc_splats *splats); /* NULL is fine */

#endif
