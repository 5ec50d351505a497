/* The splatter: pictures of voxel models as opaque or translucent objects; hidden voxels are culled first (paper 004,
 * section 3.3).
 *
 * Opaque: each splat (splats.h) with a free face towards the eye covers an ellipse, the projection of a ball of the
 * kernel's radius, at its own depth. The ellipse's core hides what lies behind it. At a pixel the nearest core counts,
 * and with it all ellipses less than 2.25 kernel radii behind or before it: their normals and colours are averaged by
 * the weights of the footprint table at d^2 + (depth / 2.25 radii)^4, divided by the sum of weights (so that a constant
 * solid is constant), and lit (raycast/shading.h). Pixels without a core, at outlines, are partly covered. Where voxels
 * are larger than pixels, kernels take the shapes of what they are part of (shape_tmpl.h): flat ones that
 * touch the surface from within, sheets, and lines whose voxels touch by corners alone. Lines are lit as cylinders and
 * single voxels as balls (round_tmpl.h). Then surfaces count that face the eye although their voxels' free faces do not.
 *
 * The clip box and planes, and the sides of the grid, cut surfaces pixel by pixel (cut_tmpl.h) and lay open what is inside
 * (tc_splats_cut()); the face ends where the surface does. A translucent object loses whole voxels.
 *
 * Culling changes no bit of the picture. It leaves out interior voxels, bricks and splats whose free faces look away,
 * those outside the picture, and those behind the depths of a first pass. What these leave is kept as it was projected,
 * for the second pass, which fetches attributes once a pixel shows the splat.
 *
 * Translucent (scene.splat.opaque false): all voxels count. The object is the field sum over voxels of extinction times
 * a Gaussian of 0.6 kernel radii (of integral 1: a constant solid is constant within 0.1 %), cut off at three
 * deviations. Sheets of voxels along the axis nearest to the view direction are summed one by one and composited front
 * to back. */
#ifndef TC_SPLAT_SPLATTER_H
#define TC_SPLAT_SPLATTER_H

#include "renderer/splat/tile.h"
#include "renderer/tomocast.h"

#define TC_SPLAT_CORE 0.87 /* of a kernel of one voxel; circles of 0.866 voxels around the voxels of a face cover it, however it lies */

typedef struct tc_splat_counts {
  uint64_t bricks, splats; /* of the model */
  uint64_t entries;        /* bricks in the picture */
  uint64_t visited;        /* splats that were looked at, in each tile that their brick meets */
  uint64_t depths, drawn;  /* splats, in each tile they meet */
} tc_splat_counts;

typedef struct tc_splat_job {
  const tc_volume *volume;       /* the object's place; its values are asked for by `matter` alone */
  const tc_splats *splats, *cut; /* cut: what tc_splat_planes() lay open; NULL: nothing */
  const tc_scene *scene;
  tc_splat_matter matter; /* .of wanted where the object is translucent */
  const char *isa;        /* "scalar", or NULL: the best */
  tc_pool *pool;
  const tc_halt *halt;
  tc_frame *frame; /* width, height set, buffers allocated; begun (renderer/frame/frame.h) */
  bool want_linear, want_depth;
  tc_splat_counts *counts; /* NULL: nobody counts */
} tc_splat_job;

/* False with *error: halted, or out of memory. A paused frame goes on with the tiles that are missing. */
bool tc_splat_draw(const tc_splat_job *job, GError **error);

/* What another splatter draws of an opaque job: a frame's constants, and the bricks that may be seen, nearest first. */
typedef struct tc_splat_frame {
  tc_splat_args args;
  const tc_splats *of; /* entries that are not of these are of the cut */
  tc_splat_entry *entries;
  int n_entries;
  double planes[TC_SPLAT_MOST_PLANES][4];
  double eye[3]; /* index coordinates; of a parallel projection far behind the middle of the picture */
} tc_splat_frame;
bool tc_splat_frame_begin(tc_splat_frame *frame, const tc_splat_job *job, GError **error); /* TC_ERROR_MEMORY */
void tc_splat_frame_end(tc_splat_frame *frame);

/* The longest kernel's radius over a ball's. */
static inline double tc_splat_longest(const tc_splat_args *args) {
  return 1 + (TC_SPLAT_LONG - 1) * (double)args->move;
}

/* Translucent: the axis along which the view goes furthest. */
int tc_splat_sheet_axis(const tc_splat_args *args);

/* The clip box and planes of a scene, and those sides of its grid (tc_splats.sides), in a volume's index coordinates, values
 * in mm; how many. */
int tc_splat_planes(const tc_volume *volume, const tc_scene *scene, unsigned sides, double planes[TC_SPLAT_MOST_PLANES][4]);

#endif
