/* A tile, a square part of the picture, and the kernels that draw splats into it; each instruction set compiles
 * tile_tmpl.h for itself. */
#ifndef TC_SPLAT_TILE_H
#define TC_SPLAT_TILE_H

#include <math.h>

#include "renderer/raycast/cpu/kernels.h"
#include "renderer/splat/splats.h"

#define TC_TILE 64        /* pixels a side */
#define TC_TILE_STRIDE 80 /* of a row: vectors reach over its end */
#define TC_TILE_PLANE (TC_TILE * TC_TILE_STRIDE + 48) /* values of a tile: not a multiple of a cache's ways apart */
#define TC_TILE_SHIFT 2   /* log2 of pixels a side of a block, whose greatest depth is kept for culling */
#define TC_TILE_BLOCK (1 << TC_TILE_SHIFT)
#define TC_TILE_BLOCKS (TC_TILE / TC_TILE_BLOCK)
#define TC_WEIGHT_STEPS 1024
#define TC_TILE_KEPT (1 << 20) /* bytes for splats that the first pass keeps for the second */
#define TC_SPLAT_TILT 0.5 /* sine of the angle between a surface and the free faces of its voxels, at most */
#define TC_SPLAT_ASLANT 0.3f /* from this cosine between normal and eye on a core is thicker than flat; from twice this on 1 / TC_SPLAT_FLAT times as thick, at most a ball */
#define TC_SPLAT_ON_FACE 1e-3f /* voxels: planes that are no further from a splat of a cut than the nearest and this are its face's */
#define TC_SPLAT_OVER 0.02f /* voxels that a surface goes over the plane or surface that ends it: more than packed normals and distances err */
#define TC_SPLAT_FLAT 0.4f /* thickness of a surface's kernel over its width, where voxels are large */

enum { TC_SUM_WEIGHT, TC_SUM_NORMAL, TC_SUM_COLOR = TC_SUM_NORMAL + 3, TC_SUMS = TC_SUM_COLOR + 3 };

/* A voxel's colour (0..1 a channel, compositing space) and extinction (1/mm), looked up for visible voxels only. */
typedef struct tc_splat_matter {
  void (*of)(const void *user, const int at[3], float rgbk[4]); /* NULL: all are of one colour; opaque */
  void (*ahead)(const void *user, const int at[3]); /* fetches into the cache what .of will read soon; NULL: nobody does */
  const void *user;
} tc_splat_matter;

/* A frame's constants. View space: x to the right, y down, z away from the eye, mm. */
typedef struct tc_splat_args {
  tc_shade shade;
  float direction0[3], direction_du[3], direction_dv[3]; /* from the eye through pixels, LPS */
  float right[3], down[3];                               /* view x and y, LPS */
  float width, height;                                   /* of the picture */
  bool perspective, opaque, culling, shaded;
  float axis[3][3];         /* view x, y, z of one voxel along index axis k: [row][k] */
  float scale;              /* pixels a mm, in perspective at z = 1 mm */
  float radius2, least2;    /* of the kernel, voxels; what is added for a pixel's own width; squared */
  float near_mm, window_mm; /* near plane; splats less than window_mm from the nearest core are blended with it */
  uint8_t weights[TC_WEIGHT_STEPS + 4]; /* footprint by the square of the distance over the kernel's; the last is 0 */
  float core,
      core_root; /* of the footprint that hides what is behind it: square of its size over the kernel's, and size */
  float full;    /* weight at the core's rim, and sum of weights from which on a pixel is covered */
  float open;    /* squares of distances are multiplied by it where no core is */
  float covariant[3][3];     /* of an LPS normal, its components in index space: [axis][LPS] */
  float move;                /* 0 .. 1: how much kernels have their own shapes and places; 0: all are balls */
  float touch;               /* radius of the core, voxels */
  const double (*planes)[4]; /* index coordinates */
  int n_planes;
  float beyond; /* opaque: voxels of a surface that far beyond a plane are drawn, cut by it pixel by pixel; translucent: 0 */
  float color[3]; /* where matter.of is NULL */
  tc_splat_matter matter;
  /* Translucent: index coordinates of a step of 1 mm along view x, y, z; what a splat's table is multiplied by. */
  float to_index[3][3], mass;
  const tc_halt *halt;
} tc_splat_args;

/* A brick in this frame. */
typedef struct tc_splat_entry {
  const tc_splats *of;
  tc_splat_brick brick;
  float near_mm;       /* no splat of it is nearer */
  float box[4];        /* pixels x0, y0, x1, y1 around its footprints */
  float reach;         /* pixels: no footprint goes further from its voxel */
  float at[3];         /* view space, its voxel 0 */
  float eye[3];        /* index coordinates, from its voxel 0 */
  uint8_t seen, mixed; /* faces that all of its voxels show to the eye; or each its own */
  uint8_t aslant;      /* tc_splat_aslant(): a splat with one of these faces counts if its surface faces the eye; 0: none does */
  uint8_t clipped;     /* a plane may cut its splats, or of a cut the object's surface may */
  uint32_t planes;       /* bits of the planes that can cut its splats */
} tc_splat_entry;

typedef struct tc_splat_tile {
  int x0, y0, width, height;
  float depth[TC_TILE_PLANE]; /* mm, infinite where there is nothing; translucent: transparency */
  /* Whole numbers; translucent: of a sheet optical depth (WEIGHT) and its colours (NORMAL ..), of all sheets (COLOR
   * ..). */
  float sums[TC_SUMS][TC_TILE_PLANE];
  /* Greatest depths of blocks [y][x], or greater; and of a block, the next, and the two below. */
  float farthest[TC_TILE_BLOCKS * (TC_TILE_BLOCKS + 1) + 1], farthest_of_four[TC_TILE_BLOCKS * TC_TILE_BLOCKS];
  bool stale[TC_TILE_BLOCKS][TC_TILE_BLOCKS];
  int touched[4];         /* translucent: pixels x0, y0, x1, y1 of the sheet in the making; x1 < x0: none */
  int n_kept;             /* batches of them */
  bool keeps;             /* the depth pass adds to them */
  bool left;              /* stopped by the halt: the tile is not finished */
  uint64_t visited;       /* splats of entries that were not hidden as a whole */
  uint64_t depths, drawn; /* splats that were put into the depths; into the sums */
  _Alignas(16) uint8_t kept[TC_TILE_KEPT]; /* splats that the depths so far do not hide, projected */
} tc_splat_tile;

typedef struct tc_splat_kernels {
  void (*depths)(const tc_splat_args *args, const tc_splat_entry *entry, tc_splat_tile *tile);
  /* Of the splats that were kept; and of an entry whose splats were not. */
  void (*kept)(const tc_splat_args *args, tc_splat_tile *tile);
  void (*colors)(const tc_splat_args *args, const tc_splat_entry *entry, tc_splat_tile *tile);
  /* [height][width][4] floats: premultiplied colour and opacity. */
  void (*shade)(const tc_splat_args *args, const tc_splat_tile *tile, float *out);
  /* Translucent: adds depths and colours of the splats with coordinate `at` (0..15) along an axis of the brick ... */
  void (*sheet)(const tc_splat_args *args, const tc_splat_entry *entry, int axis, int at, tc_splat_tile *tile);
  /* ... puts the sheet behind what is there, and makes room for the next; and the picture of all. */
  void (*compose)(tc_splat_tile *tile);
  void (*emit)(const tc_splat_tile *tile, float *out);
  size_t batch; /* bytes of a batch that is kept */
  uint32_t lanes; /* splats of a batch */
} tc_splat_kernels;

extern const tc_splat_kernels tc_splat_scalar, tc_splat_avx2;

/* Faces of a brick's voxels that a surface which faces the eye can have, although they need not face it themselves: bits. eye: index
 * coordinates; brick: in bricks. */
static inline uint8_t tc_splat_aslant(const double eye[3], const int brick[3]) {
  double to_eye[3], square = 0;
  uint8_t faces = 0;
  for (int k = 0; k < 3; k++) to_eye[k] = eye[k] - (brick[k] + 0.5) * TC_SPLAT_BRICK + 0.5, square += to_eye[k] * to_eye[k];
  const double flat = TC_SPLAT_TILT * sqrt(square);
  for (int k = 0; k < 3; k++) faces |= (uint8_t)((to_eye[k] < flat) << 2 * k | (to_eye[k] > -flat) << (2 * k + 1));
  return faces;
}

/* Brings `farthest` up to date in a box (of the tile): x0, y0, x1, y1. */
void tc_tile_refresh(tc_splat_tile *tile, const int box[4]);
/* Whether every pixel of a box (of the tile) already shows something nearer than z, as far as `farthest` knows. */
bool tc_tile_hides(const tc_splat_tile *tile, int x0, int y0, int x1, int y1, float z);
/* Depths there have changed. */
static inline void tc_tile_touch(tc_splat_tile *t, int x0, int y0, int x1, int y1) {
  for (int by = y0 / TC_TILE_BLOCK; by <= y1 / TC_TILE_BLOCK; by++)
    for (int bx = x0 / TC_TILE_BLOCK; bx <= x1 / TC_TILE_BLOCK; bx++) t->stale[by][bx] = true;
}

#endif
