/* The rasteriser's inner loops: one text (raster_tmpl.h) over the vector vocabulary, instantiated per instruction set.
 * Exact: no multiply and add is fused, and every instruction set gives the same bits. Private to mesh/. */
#ifndef TC_MESH_RASTER_KERNELS_H
#define TC_MESH_RASTER_KERNELS_H

#include "renderer/mesh/clip.h"
#include "renderer/mesh/raster.h"

enum {
  TC_RASTER_BLOCK = 8, /* pixels of a block of hierarchical depth */
  TC_RASTER_BLOCKS = TC_RASTER_SIDE / TC_RASTER_BLOCK,
  TC_RASTER_PIXELS = TC_RASTER_SIDE * TC_RASTER_SIDE,
  TC_RASTER_BATCH = 256 /* fragments that are shaded together */
};

#define TC_RASTER_NOTHING UINT32_MAX /* no triangle; a triangle's id is TC_CLUSTER_TRIANGLES * cluster + its number there */

/* Constants of a frame. Fixed-point numbers are integers held in floats, which is exact. */
typedef struct tc_raster_frame {
  const tc_clusters *mesh;
  const tc_mesh_view *view;
  const tc_raster_look *looks;
  int n_looks;
  const tc_raster_surface *surfaces;
  const float *channels; /* [256]; NULL: no surface is colored */
  bool perspective;
  float to_fixed[2][4];  /* rows of the view in 256ths of a pixel */
  float centre_fixed[2]; /* likewise */
  float rows[3][4];      /* right, down, depth; mm */
  float reference, inverse_scale, centre[2];
  float behind[2]; /* view->behind: by = behind[0] + behind[1] (near + 1) turns a nearness into (near - by) / (1 + behind[1] (near + 1)) */
  int n_samples;
  float offset[TC_RASTER_SAMPLES][2]; /* of a sample in its pixel, from the left upper corner, fixed point */
  float least_offset[2], most_offset[2];
} tc_raster_frame;

/* A sample that a translucent triangle covers. */
typedef struct tc_raster_layer {
  uint32_t at, id; /* at: as in tc_raster_tile.near */
  float near;
} tc_raster_layer;

typedef struct tc_raster_layers {
  size_t n, room; /* n > room: the list was too short and n are needed */
  tc_raster_layer *of;
} tc_raster_layers;

typedef struct tc_raster_tile {
  int x0, y0, width, height;
  float *near;   /* [samples][TC_RASTER_SIDE][TC_RASTER_SIDE] and a vector more; -INFINITY: nothing; INFINITY outside
                    width and height */
  uint32_t *id;  /* likewise */
  float *far;    /* [TC_RASTER_BLOCKS^2] smallest nearness of each block, unless it is stale */
  uint64_t stale;
  bool one_sided; /* of the cluster being drawn */
  tc_raster_layers *layers; /* NULL: the cluster is opaque; otherwise its samples nearer than the opaque ones are added here */
} tc_raster_tile;

/* A batch of fragments: inputs of shading and its results. */
typedef struct tc_raster_fragments {
  int n;
  uint32_t id[TC_RASTER_BATCH];
  int pixel[TC_RASTER_BATCH];   /* index in the tile */
  float share[TC_RASTER_BATCH]; /* share of the pixel's samples */
  float x[TC_RASTER_BATCH], y[TC_RASTER_BATCH]; /* pixels of the picture */
  float color[3][TC_RASTER_BATCH], depth[TC_RASTER_BATCH];
  int n_colored; /* fragments that fetched vertex colours */
} tc_raster_fragments;

struct tc_raster_kernels {
  /* Draws a cluster into the tile; planes: bits of the clip planes that may cut it. */
  void (*draw)(const tc_raster_frame *frame, tc_raster_tile *tile, uint32_t cluster, uint32_t planes,
               tc_raster_counts *counts);
  void (*shade)(const tc_raster_frame *frame, tc_raster_fragments *fragments);
};

extern const tc_raster_kernels tc_raster_scalar, tc_raster_avx2, tc_raster_avx512;

/* Sorts what was found into pixels: first[p] .. first[p + 1] of what is returned, which is behind what was found. */
tc_raster_layer *tc_raster_layers_by_pixel(tc_raster_layers *layers, uint32_t first[TC_RASTER_PIXELS + 1]);
/* A pixel's: sample by sample, the nearest first, of equal ones that of the first number. */
void tc_raster_layers_by_depth(tc_raster_layer *of, size_t n);

#endif
