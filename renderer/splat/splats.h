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
 * An object goes on beyond the sides of its grid as it is at them, and the sides cut it as clip planes do, half a voxel
 * beyond the voxels beside them: where it reaches a side no face is free, and tc_splats_cut() adds the flat end.
 *
 * Interior voxels are no splats, since no eye sees them. A splat is invisible, too, to an eye on the filled side of all
 * its free faces, unless voxels are larger than pixels and its surface faces the eye: where a surface is seen at a flat
 * angle, most of its voxels have no free face that the eye sees. */
#ifndef TC_SPLAT_SPLATS_H
#define TC_SPLAT_SPLATS_H

#include "renderer/scene/scene.h"
#include "renderer/splat/vmd.h"

#define TC_SPLAT_BRICK 16        /* voxels along an edge */
#define TC_SPLAT_PAD 16          /* words that may be read after the last */
#define TC_SPLAT_MOST_PLANES 18  /* that cut an object: TC_MAX_CLIP_PLANES, and the six sides of its grid */
#define TC_SPLAT_LONG 1.3        /* half length of a line's kernel over a usual kernel's; voxels that an end goes on, at most */
/* Splats of a model: with it sums over any pixel stay below 2^31, seen from however far. The bones
 * of 512x512x1000 voxels have two to three million (renderer/NUMERICS.md). */
#define TC_SPLAT_MOST ((1u << 24) - 1)

/* In bits 6 and 7 of a thin voxel's inset: what its filled neighbours (of 26) form. A line's normal is its direction,
 * an end's too, outwards; a dot has none. An end has in bits 0 to 2 how far on it ends, in sevenths of TC_SPLAT_LONG
 * voxels, and in bits 3 to 5 its thickness, from 0.3 on in tenths. */
typedef enum tc_splat_thin { TC_SPLAT_SHEET, TC_SPLAT_LINE, TC_SPLAT_END, TC_SPLAT_DOT } tc_splat_thin;

/* Whether faces (6 bits) lie opposite each other. */
static inline bool tc_splat_is_thin(unsigned faces) { return (faces & faces >> 1 & 0x15) != 0; }

/* A brick, whose splats are sorted by their free faces. */
typedef struct tc_splat_brick {
  uint32_t first, count; /* of its splats */
  int at[3];             /* in bricks */
  uint8_t faces;         /* of its splats; of few splats perhaps more */
} tc_splat_brick;

/* Bricks are read one after the other. Where an object is thin few splats share one, so that each takes two to four
 * bytes as a rule: a byte with the number of splats (bits 0 to 5; 63: it follows in two bytes) and the way from the
 * brick before (bits 6 and 7); bytes of the way; and the faces, if it has 16 splats or more. */
typedef struct tc_splats {
  uint8_t *bricks;
  uint32_t *words;   /* [n + TC_SPLAT_PAD] */
  uint8_t *insets;   /* the same */
  uint32_t *rims;    /* the same; of a cut: where the object's surface passes the voxel, too, its splat's word with the inset
                        in the position's place (bits 0 to 7; lines and single voxels: 0), else 0. NULL: no cut */
  uint32_t n, n_bricks;
  bool cut;          /* clipping left them */
  uint8_t sides;     /* of the grid that the object reaches: bits as of free faces */
  size_t bytes;
  uint64_t serial; /* of no other */
} tc_splats;

/* The way from the brick before: the next along z; further along z (a byte: how far); along x (a byte), and along z (a
 * signed byte); or somewhere else (x, y, z: two bytes each). The first comes from 0, 0, 0. */
typedef enum tc_splat_way { TC_SPLAT_NEXT, TC_SPLAT_FURTHER, TC_SPLAT_COLUMN, TC_SPLAT_ELSEWHERE } tc_splat_way;

/* The brick after one, which begins as zeros with *from 0; *from counts the bytes read. */
static inline void tc_splats_next(const tc_splats *s, size_t *from, tc_splat_brick *brick) {
  const uint8_t *p = s->bricks + *from;
  const unsigned head = *p++;
  brick->first += brick->count;
  brick->count = head & 63;
  if (brick->count == 63) brick->count = p[0] | (uint32_t)p[1] << 8, p += 2;
  switch ((tc_splat_way)(head >> 6)) {
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
/* Outward normal (LPS, any length) of a voxel from the 5x5x5 voxels around it, of which `filled` are filled: sum is minus
 * the sum of their steps from it. Returns the distance of the surface, were it a plane, in voxels. */
double tc_splats_filled_normal(const tc_volume_desc *grid, const int sum[3], int filled, double normal[3]);
/* The voxels that planes (index coordinates, what is kept has planes[i] . (position, 1) >= 0; TC_SPLAT_MOST_PLANES at most) lay
 * open. of: the splats of the whole model. */
tc_splats *tc_splats_cut(const tc_vmd *model, const tc_splats *of, const double planes[][4], int n_planes, const tc_halt *halt,
                         GError **error);
void tc_splats_free(tc_splats *splats); /* NULL is fine */

#endif
