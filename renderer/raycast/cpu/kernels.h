/* The CPU ray caster's kernels: one algorithm (kernels_tmpl.h), instantiated per instruction set.
 *
 * Every instantiation is tolerant, not exact, against the scalar one: the vector ones fuse multiply and add. Within one
 * instruction set a pixel's bytes depend on nothing but the scene: not on tiles, threads or neighbours. */
#ifndef TC_CPU_KERNELS_H
#define TC_CPU_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/classify/classify.h"
#include "renderer/plan/key.h"
#include "renderer/raycast/grey.h"
#include "renderer/raycast/rays.h"

/* renderer/halt.h; not all of it, for kernels take long to compile. */
typedef struct tc_halt tc_halt;
bool tc_halt_within(const tc_halt *halt);

/* A zoom of the table, in nodes of the table itself. */
typedef struct tc_cpu_zoom {
  float lo, scale; /* its node = (node - lo) * scale */
  float start;     /* entries from the table's row k = 0 to its own; exact below 2^24 */
  float rim;       /* of its nodes, at either end */
  float inner[2];  /* between the rims, in nodes of the table */
} tc_cpu_zoom;

/* Of a picture with labels (classify/labels.h). */
typedef struct tc_cpu_labels {
  float matrix[3][4]; /* tc_labels_matrix() */
  float last[3];      /* as below, of the label volume */
  int cell_last[3], stride[3], row, slice;
  int type, nearest;
  const void *voxels;
  float base;
  const float *entries; /* [n][8] */
  const float *outside; /* [5] */
} tc_cpu_labels;

/* A frame's constants in single precision (raycast/rays.h says what they mean). Read-only while kernels run. */
typedef struct tc_cpu_args {
  tc_plan_key key;
  float anchor0[3], anchor_du[3], anchor_dv[3];
  float view0[3], view_du[3], view_dv[3];
  float to_index[9];
  float eye_mm, far_mm;
  int perspective;
  float lo[3], hi[3]; /* index box of the field */
  float planes[TC_MAX_CLIP_PLANES][4];
  int n_planes;
  float last[3];      /* n - 1: positions are clamped to [0, last] before a cell is found */
  int cell_last[3];   /* max(n - 2, 0) */
  int stride[3];      /* voxels from a cell corner to its neighbour; 0 where n = 1 */
  int row, slice;     /* voxels from one y, one z to the next */
  float step_mm, inverse_step;
  struct tc_cpu_ray { float x, y, phase; } of_pixel[TC_MAX_RAYS_PER_PIXEL]; /* subpixel.h */
  int count;       /* of them */
  const void *voxels;
  const float *table; /* row k = 0 of tc_table */
  float table_stride; /* entries a row; offsets are computed in float, exact below 2^24 */
  const float *integrals;        /* tc_integrals' entries */
  int levels_start, level_row;   /* entries before the levels; of one level */
  float value_lo, value_scale, node_last; /* node = (voxel - value_lo) * value_scale, clamped to [0, node_last] */
  int n_zooms;
  tc_cpu_zoom zooms[TC_MAX_ZOOMS];
  float termination;
  float window_center, window_gain; /* grey = (node - center) * gain + 0.5; modes without a table */
  int block_row, block_slice;
  float zero_below, zero_above; /* nodes */
  const uint8_t *distance; /* tc_leap, when an isosurface leaps */
  float block;             /* voxels its blocks are wide */
  const uint64_t *cover; /* tc_cover, when dvr leaps */
  /* _cells: along x; _row: words from one row of cells to the next */
  int cover_shift, cover_cells, cover_row, cover_words;
  float cover_near, cover_slot, cover_depth; /* mm */
  float turn, gain, offset, floor, stop; /* tc_grey, when the plan projects */
  const float *to_light; /* tc_resolve_light(), when it does in linear light */
  const uint8_t *levels; /* tc_bounds, when it skips too */
  float inverse_block;   /* of its blocks, or the tc_leap's, voxels */
  float level_scale;
  int interval; /* samples that one level serves */
  /* Of shaded variants (raycast/shade.h). */
  float gradient[9], flat, inverse_steep; /* inverse_steep: 1 / (1 - flat) */
  float factor[2], glow[2][3], least_lit, specular, shininess, light[3];
  int head_light;
  tc_cpu_labels labels;
  const tc_halt *halt; /* or NULL */
} tc_cpu_args;

/* Steps of a packet between two looks at the halt: at most some 2 ms (cubic, lit with cubic gradients). */
#define TC_CPU_LOOK 512

/* What a worker counts of a unit, and how far it is. */
typedef struct tc_cpu_counts {
  uint64_t samples, rays, gradients, leaps; /* leaps: of whole packets */
  int until_look; /* steps; TC_CPU_LOOK to begin with */
  bool left;      /* the halt wanted it: out is not finished, from pixel packet `packet` and its ray `ray` on */
  int packet, ray; /* where to begin */
} tc_cpu_counts;

/* Renders pixels [x0, x1) x [y0, y1) to out, [y1-y0][stride][4] floats: premultiplied colour and opacity. Lanes of a
 * packet beyond x1 or y1 are masked. Left, it goes on when it is called again with the same counts and out: sums of the
 * rays so far are there. */
typedef void (*tc_cpu_kernel)(const tc_cpu_args *args, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,
                              tc_cpu_counts *counts);

/* NULL where this instruction set has no variant for the key. */
tc_cpu_kernel tc_kernel_scalar(const tc_plan_key *key);
tc_cpu_kernel tc_kernel_avx2(const tc_plan_key *key);
tc_cpu_kernel tc_kernel_avx512(const tc_plan_key *key);

#endif
