/* The CPU ray caster's kernels: one text (kernels_tmpl.h, isosurface_kernels_tmpl.h) over the vector vocabulary (simd.h), compiled
 * once per instruction set.
 *
 * Within one instruction set, a pixel's bytes depend on the scene alone: not on tiles, threads or neighbouring
 * pixels. Between instruction sets pictures agree within a tolerance, because vector kernels fuse multiply and add. */
#ifndef TC_CPU_KERNELS_H
#define TC_CPU_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/plan/key.h"
#include "renderer/classify/preintegration.h"
#include "renderer/classify/transfer.h"
#include "renderer/raycast/jitter.h"
#include "renderer/raycast/projection.h"
#include "renderer/raycast/rays.h"
#include "renderer/raycast/shading.h"
#include "renderer/raycast/isosurface.h"
#include "renderer/skip/cover.h"

/* From renderer/base/halt.h; a forward declaration, so that changes of that header do not recompile all kernels. */
typedef struct tc_halt tc_halt;
bool tc_halt_within(const tc_halt *halt);

/* Voxels on a grid. */
typedef struct tc_cpu_grid {
  const void *voxels;
  int row, slice;   /* stride in voxels along y and along z */
  float last[3];    /* n - 1: positions are clamped to [0, last] */
  int cell_last[3]; /* max(n - 2, 0): the last cell along an axis */
  int stride[3];    /* voxels from a cell's corner to the next one; 0 if n = 1 */
} tc_cpu_grid;

/* One byte per block: levels (skip/bounds.h) or distances (skip/skip.h). */
typedef struct tc_cpu_blocks {
  const uint8_t *values;
  float width, inverse_width; /* of a block, voxels */
  int row, slice;
} tc_cpu_blocks;

/* A subtable of the pre-integration table, in nodes of the table itself. */
typedef struct tc_cpu_subtable {
  float lo, scale; /* node of the subtable = (node - lo) * scale */
  float start;     /* entries from the table's row k = 0 to the subtable's; exact below 2^24 */
  float rim;       /* width of the margin at either end, in nodes of the subtable */
  float inner[2];  /* the subtable without its margins, in nodes of the table */
} tc_cpu_subtable;

/* A picture with labels (classify/labels.h). */
typedef struct tc_cpu_labels {
  tc_cpu_grid grid;   /* the label volume */
  float matrix[3][4]; /* tc_labels_matrix() */
  int type, nearest;
  float base;
  const float *entries; /* [n][8] */
  const float *outside; /* [5] */
} tc_cpu_labels;

/* Largest mean number of neighbourhoods per step of a packet for which loads are slower (neighbourhood_tmpl.h). */
#define TC_MOST_NEIGHBOURHOODS 1.35f

/* A frame's constants, read-only while kernels run. Pointers are borrowed; members that the plan does not name are
 * zero. */
typedef struct tc_cpu_args {
  tc_plan_key key;
  tc_cpu_grid grid; /* the sampled field */
  /* From voxels to nodes: node = (voxel - lo) * scale, clamped to [0, last]. */
  struct { float lo, scale, last; } nodes;
  const float *table; /* row k = 0 of tc_table */
  float table_stride; /* entries per row; offsets are computed in float, exact below 2^24 */
  float termination;  /* transparency below which early ray termination ends a ray; 0: none ends early */
  float zero_below, zero_above; /* nodes: segments below or above contribute nothing (tc_support_zones()) */
  int n_subtables;
  tc_cpu_subtable subtables[TC_MAX_SUBTABLES];
  const float *integrals;      /* tc_integrals' entries */
  int levels_start, level_row; /* entries before the levels; per level */
  tc_cpu_blocks blocks;        /* empty-space skipping in projections (levels) and for isosurfaces (distances) */
  float level_scale;           /* levels per unit of projection.h's w */
  int interval;                /* samples that one level serves */
  tc_cover cover;              /* empty-space skipping in dvr */
  tc_grey grey;                /* projections */
  const float *to_light;       /* tc_resolve_light(): greys become linear light; or NULL */
  struct { float center, gain; } window; /* mpr: tc_slice_window */
  tc_shade shade;
  tc_surface surface;
  float *depth; /* [picture's height][width], mm from the eye to the isosurface; NULL unless the frame wants it */
  int width;
  tc_cpu_labels labels;
  bool near; /* use register neighbourhoods where they are faster (neighbourhood_tmpl.h); false: load pairs */
  bool gather; /* gather scattered voxels, for an instruction set that can (V_GATHERS, simd.h); false: a load per lane */
  bool near_slopes; /* and, of integer voxels, for gradients: the differences of voxels fit 16 bits */
  const tc_halt *halt; /* or NULL */
  tc_rays_single rays;
} tc_cpu_args;

/* Steps of a packet between two polls of the halt: at most some 2 ms (cubic filter, lit with cubic gradients). */
#define TC_CPU_POLL_STEPS 512

/* A worker's counters, and its position in a unit of pixels. */
typedef struct tc_cpu_counts {
  uint64_t samples, rays, gradients, leaps; /* leaps: jumps of whole packets over empty space */
  int until_poll;  /* steps until the next poll; initially TC_CPU_POLL_STEPS */
  bool left;       /* the halt interrupted the unit, which resumes at `packet` and `ray` */
  int packet, ray; /* the packet of pixels to start at, and the ray of its pixels */
} tc_cpu_counts;

/* Renders pixels [x0, x1) x [y0, y1) to out, [y1-y0][stride][4] floats: premultiplied colour and opacity. Lanes of a
 * packet beyond x1 or y1 are masked. An interrupted kernel (counts->left) resumes when it is called again with the
 * same counts and out, which holds the sums of the rays so far. */
typedef void (*tc_cpu_kernel)(const tc_cpu_args *args, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,
                              tc_cpu_counts *counts);

/* The kernel for a plan's key; NULL: no such kernel, or the build leaves out the instruction set (TC_AVX512 in CMakeLists.txt).
 * Kernels of mode isosurface are in separate translation units, which compile in parallel with the others. */
tc_cpu_kernel tc_kernel_scalar(const tc_plan_key *key);
tc_cpu_kernel tc_kernel_avx2(const tc_plan_key *key);
tc_cpu_kernel tc_kernel_avx512(const tc_plan_key *key);
tc_cpu_kernel tc_surface_kernel_scalar(const tc_plan_key *key);
tc_cpu_kernel tc_surface_kernel_avx2(const tc_plan_key *key);
tc_cpu_kernel tc_surface_kernel_avx512(const tc_plan_key *key);

/* tc_kernel_avx2() among the kernels of one voxel type (tc_kernel_avx2_u8()), and those of any type: kernels_avx2.c is compiled for
 * each, with TC_VOXELS defined as u8, for example, so that they compile in parallel. */
#define TC_KERNEL_FINDERS(OP, isa) OP(isa, u8) OP(isa, i8) OP(isa, u16) OP(isa, i16) OP(isa, f32) OP(isa, any)
#define TC_KERNEL_FINDER(isa, voxels) tc_cpu_kernel tc_kernel_##isa##_##voxels(const tc_plan_key *key);
TC_KERNEL_FINDERS(TC_KERNEL_FINDER, scalar)
TC_KERNEL_FINDERS(TC_KERNEL_FINDER, avx2)
TC_KERNEL_FINDERS(TC_KERNEL_FINDER, avx512)

#endif
