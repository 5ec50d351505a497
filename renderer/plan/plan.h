/* The render plan: the one place that decides what a frame needs. A pure function of the scene, the volume and the back
 * end; immutable afterwards. Circumstances known only when a frame is drawn (nothing was empty, the cpu stood in) are
 * facts of the frame (tc_facts). plan/explain.h describes both in words.
 *
 * The projections (mip, minip, average) map the field by the window alone: transferFunction, classification, order,
 * shading and sampling.termination have no effect. They are neither read nor refused, and are 0 in the key.
 *
 * Mode isosurface (raycast/isosurface.h) reads isosurface and shading; it has no transfer function, no window and no
 * steps. An iso value outside the volume's range gives an empty picture, and the gradient stage says so. Mode mesh
 * rasterises the same surface as triangles (mesh/raster.h): normals are those of the vertices, by central differences,
 * and the rays of a pixel are its coverage samples. */
#ifndef TC_RENDERER_PLAN_H
#define TC_RENDERER_PLAN_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/classify/preintegration.h"
#include "renderer/base/error.h"
#include "renderer/plan/key.h"
#include "renderer/raycast/projection.h"
#include "renderer/raycast/isosurface.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

/* Resources of a frame in addition to the volume, in build order: each may read earlier ones. */
typedef enum tc_resource {
  TC_RESOURCE_COEFFICIENTS, /* B-spline coefficients, sampled instead of the voxels */
  TC_RESOURCE_TABLE,        /* full pre-integration table */
  TC_RESOURCE_INTEGRALS,    /* 1-D tables of classifications without a pre-integration table */
  TC_RESOURCE_SUPPORT,      /* values with extinction above 0 */
  TC_RESOURCE_MINMAX,       /* minima and maxima of blocks */
  TC_RESOURCE_DISTANCE_MAP, /* distance map of empty blocks */
  TC_RESOURCE_FINE,         /* minima and maxima of fine boxes */
  TC_RESOURCE_BOXES,        /* boxes around occupied space */
  TC_RESOURCE_BOUNDS,       /* upper bounds of the field around each block */
  TC_RESOURCE_LABELS,       /* colours and opacities of labels */
  TC_RESOURCE_MESH,         /* surfaces as clusters of triangles */
  TC_RESOURCE_MODEL,        /* run-length model of the voxels within splat.threshold */
  TC_RESOURCE_SPLATS,       /* splats of the model's surface voxels */
  TC_RESOURCE_CUT,          /* splats of voxels that clipping exposes */
  TC_RESOURCE_COUNT
} tc_resource;

typedef struct tc_plan {
  tc_plan_key key;
  int width, height;
  double step_mm;         /* world length of a full segment */
  uint32_t resources;     /* bit set: 1 << tc_resource of each resource that the frame reads */
  tc_table_params table;  /* mode dvr: parameters of the table or the integrals; .tf is the scene's */
  int block, reach;       /* empty-space skipping, in voxels: width of a block, and reach of the filter beyond it */
  tc_grey grey;           /* projections */
  tc_surface surface;     /* isosurfaces and their meshes */
  bool depth;             /* the frame has a depth output */
  double mesh_pixels;     /* largest error of a mesh's level of detail, in pixels of the picture */
} tc_plan;

/* Further inputs of a plan. All zero: the scene's own size, drawn by the cpu. */
typedef struct tc_plan_request {
  int width, height;         /* 0 = the scene's own */
  bool maps_distance;        /* dvr skips empty space by a distance map; false: by boxes */
  bool want_depth;           /* the depth output is requested */
  bool moving;               /* as in tc_render_request, as is what follows */
  int coarser_levels;
  const tc_volume *field;    /* the volume's B-spline coefficients; NULL while not built: the table is then chosen for
                                the range of the voxels, which coefficients may exceed */
  int table_size, table_bits; /* as in tc_render_request */
} tc_plan_request;

/* Plans a scene that passed tc_plan_check(). request may be NULL. Pure. */
void tc_plan_make(const tc_volume *volume, const tc_scene *scene, const tc_plan_request *request, tc_plan *plan);

static inline bool tc_plan_has(const tc_plan *plan, tc_resource resource) { return plan->resources >> resource & 1; }
static inline void tc_plan_drop(tc_plan *plan, tc_resource resource) { plan->resources &= ~(1u << resource); }

/* The one validator of scenes: TC_ERROR_UNSUPPORTED, TC_ERROR_INVALID or TC_ERROR_LIMIT with a pointer to the member that
 * cannot be rendered. valid: a scene of the same volume that passed earlier, or NULL; lists shared with it are not
 * checked again. Pure. */
bool tc_plan_check(const tc_volume *volume, const tc_scene *scene, int width, int height, const tc_scene *valid,
                   GError **error);

#endif
