/* A tile, a square part of the picture, and the functions that draw splats into it. tile_tmpl.h is compiled once for each
 * instruction set. */
#ifndef TC_SPLAT_TILE_H
#define TC_SPLAT_TILE_H

#include <math.h>

#include "renderer/raycast/cpu/kernels.h"
#include "renderer/splat/splats.h"

#define TC_TILE 64        /* pixels a side */
#define TC_TILE_STRIDE 80 /* of a row: vectors may be stored beyond its end */
#define TC_TILE_PLANE (TC_TILE * TC_TILE_STRIDE + 48) /* values of a tile; no power of two, which would fill the same cache sets */
#define TC_TILE_SHIFT 2   /* log2 of a block's side in pixels; culling uses the greatest depth of each block */
#define TC_TILE_BLOCK (1 << TC_TILE_SHIFT)
#define TC_TILE_BLOCKS (TC_TILE / TC_TILE_BLOCK)
#define TC_WEIGHT_STEPS 1024
#define TC_TILE_KEPT (1 << 20) /* bytes for projected splats that the depth pass keeps for the colour pass */
#define TC_SPLAT_TILT 0.5 /* largest sine of the angle between a surface and its voxels' free faces */
/* Cosine between normal and eye direction above which cores become thicker. From twice this cosine on they are
 * 1 / TC_SPLAT_FLAT times as thick, but no thicker than a ball. */
#define TC_SPLAT_ASLANT 0.3f
#define TC_SPLAT_ON_FACE 1e-3f /* voxels: tolerance for the planes on which a splat of a cut face lies */
/* Voxels by which surfaces extend beyond the plane or surface that ends them: above the error of packed normals and distances. */
#define TC_SPLAT_OVER 0.02f
#define TC_SPLAT_FLAT 0.4f /* thickness of a surface's kernel over its width, where voxels are large */

enum { TC_SUM_WEIGHT, TC_SUM_NORMAL, TC_SUM_COLOR = TC_SUM_NORMAL + 3, TC_SUMS = TC_SUM_COLOR + 3 };

/* Look-up of a voxel's colour (0..1 a channel, compositing space) and extinction (1/mm); called for visible voxels only. */
typedef struct tc_splat_material {
  void (*color)(const void *user, const int at[3], float rgbk[4]); /* NULL: an opaque object of one colour */
  void (*prefetch)(const void *user, const int at[3]); /* loads what .color will read into the cache; may be NULL */
  const void *user;
} tc_splat_material;

/* A frame's constants. View space: x to the right, y down, z away from the eye, mm. */
typedef struct tc_splat_args {
  tc_shade shade;
  float direction0[3], direction_du[3], direction_dv[3]; /* from the eye through pixels, LPS */
  float right[3], down[3];                               /* view x and y, LPS */
  float width, height;                                   /* of the picture */
  bool perspective, opaque, culling, shaded;
  float axis[3][3];         /* view x, y, z of one voxel along index axis k: [row][k] */
  float scale;              /* pixels a mm, in perspective at z = 1 mm */
  float radius2;            /* square of the kernel's radius, voxels */
  float pixel_radius2;      /* square of the radius by which a footprint is widened so that it holds a pixel's centre, pixels */
  float near_mm, window_mm; /* near plane; splats less than window_mm from the nearest core are blended with it */
  uint8_t weights[TC_WEIGHT_STEPS + 4]; /* footprint by the square of the distance over the kernel's; the last is 0 */
  float core2, core_share;  /* radius of the core, a footprint's opaque middle, over the kernel's: squared, and itself */
  float full_weight;        /* weight at the rim of a core: a pixel with this sum of weights is covered */
  float coreless_scale;     /* factor of the squared distances at pixels without a core */
  float covariant[3][3];     /* of an LPS normal, its components in index space: [axis][LPS] */
  float shape_blend;        /* 0: all kernels are balls; 1: kernels have shapes and offsets of their own (shape_tmpl.h) */
  float core_radius;        /* voxels */
  const double (*planes)[4]; /* index coordinates */
  int n_planes;
  float clip_reach; /* opaque: voxels of a surface up to this far beyond a plane are drawn, clipped per pixel; translucent: 0 */
  float color[3]; /* used if material.color is NULL */
  tc_splat_material material;
  /* Translucent: steps of 1 mm along view x, y, z in index coordinates; factor of a splat's footprint. */
  float to_index[3][3], mass;
  const tc_halt *halt;
} tc_splat_args;

/* A brick in this frame. */
typedef struct tc_splat_entry {
  const tc_splats *of;
  tc_splat_brick brick;
  float near_mm;       /* lower bound of its splats' depths */
  float box[4];        /* pixels x0, y0, x1, y1 around its footprints */
  float reach;         /* pixels: largest distance of a footprint's edge from its voxel */
  float at[3];         /* its voxel 0 in view space */
  float eye[3];        /* the eye in index coordinates, relative to its voxel 0 */
  uint8_t seen, mixed; /* faces of its voxels that face the eye; mixed: they differ from voxel to voxel */
  uint8_t aslant;      /* tc_splat_aslant(): splats with one of these faces are drawn if their surface faces the eye */
  uint8_t clipped;     /* a plane, or in a cut face the object's surface, may clip its splats */
  uint32_t planes;     /* bits of the planes that may clip its splats */
} tc_splat_entry;

typedef struct tc_splat_tile {
  int x0, y0, width, height;
  float depth[TC_TILE_PLANE]; /* mm, infinite without a core; translucent: transparency */
  /* Opaque: integers. Translucent: a sheet's optical depth (WEIGHT) and colours (NORMAL ..), and the colours of all
   * composited sheets (COLOR ..). */
  float sums[TC_SUMS][TC_TILE_PLANE];
  /* Upper bounds of the depths in blocks [y][x], and in 2x2 blocks from each block on. */
  float farthest[TC_TILE_BLOCKS * (TC_TILE_BLOCKS + 1) + 1], farthest_of_four[TC_TILE_BLOCKS * TC_TILE_BLOCKS];
  bool stale[TC_TILE_BLOCKS][TC_TILE_BLOCKS];
  int touched[4];         /* translucent: bounding box x0, y0, x1, y1 of the current sheet; x1 < x0: empty */
  int n_kept;             /* batches in `kept` */
  bool keeps;             /* the depth pass adds batches to `kept` */
  bool halted;            /* stopped by the halt: the tile is not finished */
  uint64_t visited;       /* splats of entries that were not occluded as a whole */
  uint64_t depths, drawn; /* splats drawn into the depths, and into the sums */
  _Alignas(16) uint8_t kept[TC_TILE_KEPT]; /* projected splats that were not occluded in the depth pass */
} tc_splat_tile;

typedef struct tc_splat_kernels {
  void (*depths)(const tc_splat_args *args, const tc_splat_entry *entry, tc_splat_tile *tile);
  /* Draws the sums of the kept splats, and of an entry whose splats were not kept. */
  void (*kept)(const tc_splat_args *args, tc_splat_tile *tile);
  void (*colors)(const tc_splat_args *args, const tc_splat_entry *entry, tc_splat_tile *tile);
  /* [height][width][4] floats: premultiplied colour and opacity. */
  void (*shade)(const tc_splat_args *args, const tc_splat_tile *tile, float *out);
  /* Translucent: adds optical depths and colours of the splats with coordinate `at` (0..15) along an axis of the brick to
   * the current sheet. */
  void (*sheet)(const tc_splat_args *args, const tc_splat_entry *entry, int axis, int at, tc_splat_tile *tile);
  /* Composites the sheet behind those before it and clears it; writes the picture of all sheets. */
  void (*compose)(tc_splat_tile *tile);
  void (*emit)(const tc_splat_tile *tile, float *out);
  size_t batch; /* bytes of a kept batch */
  uint32_t lanes; /* splats of a batch */
} tc_splat_kernels;

extern const tc_splat_kernels tc_splat_scalar, tc_splat_avx2;

/* Bits of the faces that the voxels of a surface facing the eye can have in a brick, including faces that do not face the eye.
 * eye: index coordinates; brick: in bricks. */
static inline uint8_t tc_splat_aslant(const double eye[3], const int brick[3]) {
  double to_eye[3], square = 0;
  uint8_t faces = 0;
  for (int k = 0; k < 3; k++) to_eye[k] = eye[k] - (brick[k] + 0.5) * TC_SPLAT_BRICK + 0.5, square += to_eye[k] * to_eye[k];
  const double flat = TC_SPLAT_TILT * sqrt(square);
  for (int k = 0; k < 3; k++) faces |= (uint8_t)((to_eye[k] < flat) << 2 * k | (to_eye[k] > -flat) << (2 * k + 1));
  return faces;
}

/* Updates `farthest` in a box of the tile: x0, y0, x1, y1. */
void tc_tile_refresh(tc_splat_tile *tile, const int box[4]);
/* True if `farthest` proves that all depths in a box of the tile are less than z. */
bool tc_tile_hides(const tc_splat_tile *tile, int x0, int y0, int x1, int y1, float z);
/* Marks blocks whose depths have changed. */
static inline void tc_tile_touch(tc_splat_tile *t, int x0, int y0, int x1, int y1) {
  for (int by = y0 / TC_TILE_BLOCK; by <= y1 / TC_TILE_BLOCK; by++)
    for (int bx = x0 / TC_TILE_BLOCK; bx <= x1 / TC_TILE_BLOCK; bx++) t->stale[by][bx] = true;
}

#endif
