/* The splatter draws voxel models as opaque or translucent objects and culls hidden voxels first (paper 004, section 3.3).
 *
 * Opaque: each splat (splats.h) with a free face towards the eye covers an ellipse at the splat's depth, the projection of a
 * ball of the kernel's radius. The ellipse's core occludes everything behind it. A pixel shows its nearest core, blended with
 * all ellipses less than 2.25 kernel radii before or behind that core: their normals and colours are averaged with the weights
 * of the footprint table at d^2 + (depth / 2.25 radii)^4, divided by the sum of weights (so that a constant solid is constant),
 * and lit (raycast/shading.h). Pixels without a core, at outlines, are partly covered.
 *
 * Where voxels are larger than pixels, kernels have shapes (shape_tmpl.h): flat kernels that touch the surface from within,
 * sheets, and lines, whose voxels may touch by corners only. Lines are lit as cylinders and single voxels as balls
 * (round_tmpl.h). Splats are then also drawn if their surface faces the eye although none of their free faces does.
 *
 * The clip box and planes, and the sides of the grid, clip surfaces per pixel (cut_tmpl.h); tc_splats_cut() adds the cut faces,
 * which end at the object's surface. A translucent object is clipped by whole voxels.
 *
 * Culling changes no bit of the picture. It drops interior voxels, bricks and splats that face away from the eye or lie outside
 * the picture, and those that the depth pass occludes. The remaining projected splats are kept for the colour pass, which
 * fetches a splat's attributes only if a pixel shows the splat.
 *
 * Translucent (scene.splat.opaque false): all voxels are drawn. The object is the field sum over voxels of extinction times a
 * Gaussian with a deviation of 0.6 kernel radii (of integral 1: a constant solid is constant within 0.1 %), truncated at three
 * deviations. Sheets of voxels across the axis nearest to the view direction are summed one after the other and composited
 * front to back (translucent_tmpl.h). */
#ifndef TC_SPLAT_SPLATTER_H
#define TC_SPLAT_SPLATTER_H

#include "renderer/splat/tile.h"
#include "renderer/tomocast.h"

#define TC_SPLAT_CORE 0.87 /* core radius of a kernel of one voxel: circles of 0.866 voxels cover a face in any orientation */

typedef struct tc_splat_counts {
  uint64_t bricks, splats; /* of the model */
  uint64_t entries;        /* bricks in the picture */
  uint64_t visited;        /* splats tested, once for each tile that their brick meets */
  uint64_t depths, drawn;  /* splats drawn in the depth and colour pass, once for each tile */
} tc_splat_counts;

typedef struct tc_splat_job {
  const tc_volume *volume;       /* the object's grid; only `material` reads its values */
  const tc_splats *splats, *cut; /* cut: the cut faces of tc_splat_planes(); may be NULL */
  const tc_scene *scene;
  tc_splat_material material; /* .color is needed if the object is translucent */
  const char *isa;        /* "scalar", or NULL: the best */
  tc_pool *pool;
  const tc_halt *halt;
  tc_frame *frame; /* width, height set, buffers allocated; begun (renderer/frame/frame.h) */
  bool want_linear, want_depth;
  tc_splat_counts *counts; /* NULL: nobody counts */
} tc_splat_job;

/* False with *error: halted, or out of memory. A paused frame continues with the missing tiles. */
bool tc_splat_draw(const tc_splat_job *job, GError **error);

/* Constants of a frame and its bricks that may be visible, nearest first: input of another splatter (gl/splat.c) and of picking. */
typedef struct tc_splat_frame {
  tc_splat_args args;
  const tc_splats *of; /* all other entries are cut faces */
  tc_splat_entry *entries;
  int n_entries;
  double planes[TC_SPLAT_MOST_PLANES][4];
  double eye[3]; /* index coordinates; in a parallel projection a point far behind the picture's middle */
} tc_splat_frame;
bool tc_splat_frame_begin(tc_splat_frame *frame, const tc_splat_job *job, GError **error); /* TC_ERROR_MEMORY */
void tc_splat_frame_end(tc_splat_frame *frame);

/* Radius of the longest kernel over that of a ball. */
static inline double tc_splat_longest_kernel(const tc_splat_args *args) {
  return 1 + (TC_SPLAT_LONG - 1) * (double)args->shape_blend;
}

/* Translucent: the index axis nearest to the view direction. */
int tc_splat_sheet_axis(const tc_splat_args *args);

/* Sets the planes of a scene's clip box, its clip planes and those sides of the grid (tc_splats.sides): distance in mm as a
 * function of index coordinates. Returns their number. */
int tc_splat_planes(const tc_volume *volume, const tc_scene *scene, unsigned sides, double planes[TC_SPLAT_MOST_PLANES][4]);

#endif
