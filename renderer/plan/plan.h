/* The render plan: the one place that decides what a frame needs. A pure function of a scene, the volume, and who draws;
 * nobody changes a plan afterwards. What only a frame can find out (nothing was empty, the cpu stood in) are facts of the
 * frame, and plan/explain.h shows both in words.
 *
 * The projections (mip, minip, average) see the field through the window alone: transferFunction, classification,
 * order, shading and sampling.termination have no meaning for them; they are neither read nor refused, and are 0 in the
 * key.
 *
 * An isosurface (raycast/isosurface.h) reads isosurface and shading: it has no transfer function, no window and no steps.
 * A value that no place of the volume has is an empty picture, and the gradient stage says so. A mesh is the same surface
 * as triangles (mesh/raster.h): normals are the vertices' own, of central differences, and rays are samples of coverage. */
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

/* Resources of a frame beside the volume, in build order: each may read the ones before it. */
typedef enum tc_resource {
  TC_RESOURCE_COEFFICIENTS, /* B-spline coefficients in the voxels' place */
  TC_RESOURCE_TABLE,        /* full pre-integration table */
  TC_RESOURCE_INTEGRALS,    /* integrals T, K for approximate classification */
  TC_RESOURCE_SUPPORT,      /* values at which something shows */
  TC_RESOURCE_MINMAX,       /* minima and maxima of blocks */
  TC_RESOURCE_DISTANCE_MAP, /* distance map of empty blocks */
  TC_RESOURCE_FINE,         /* minima and maxima of fine boxes */
  TC_RESOURCE_BOXES,        /* boxes around what is not empty */
  TC_RESOURCE_BOUNDS,       /* how large the field may be around each block */
  TC_RESOURCE_LABELS,       /* colours and opacities of labels */
  TC_RESOURCE_MESH,         /* surfaces as clusters of triangles */
  TC_RESOURCE_MODEL,        /* run-length model of the voxels within splat.threshold */
  TC_RESOURCE_SPLATS,       /* splats of the model's surface voxels */
  TC_RESOURCE_CUT,          /* splats of voxels that clipping lays open */
  TC_RESOURCE_COUNT
} tc_resource;

typedef struct tc_plan {
  tc_plan_key key;
  int width, height;
  double step_mm;         /* world length of a full segment */
  uint32_t resources;     /* 1 << tc_resource of each that the frame reads */
  tc_table_params table;  /* mode dvr: of the table or the integrals; .tf is the scene's */
  int block, reach;       /* of empty-space skipping: voxels a block is wide, and the filter reaches beyond it */
  tc_grey grey;           /* of a projection */
  tc_surface surface;     /* of an isosurface, or a mesh of one */
  bool depth;             /* the frame has a depth output */
  double mesh_pixels;     /* most error of a mesh's level of detail, in pixels of the picture */
} tc_plan;

/* Inputs of a plan beside volume and scene. All zero: the scene's own size, drawn by the cpu. */
typedef struct tc_plan_request {
  int width, height;         /* 0 = the scene's own */
  bool maps_distance;        /* the back end leaps by a distance map in dvr; else by boxes */
  bool want_depth;           /* the depth output is requested */
  bool moving;               /* as in tc_render_request */
  const tc_volume *field;    /* the volume's B-spline coefficients; NULL before they are there: the table is then chosen
                                over the voxels, beyond which coefficients reach */
  int table_size, table_bits; /* as in tc_render_request */
} tc_plan_request;

/* Plans a scene that passed tc_plan_check(). request may be NULL. Pure. */
void tc_plan_make(const tc_volume *volume, const tc_scene *scene, const tc_plan_request *request, tc_plan *plan);

static inline bool tc_plan_has(const tc_plan *plan, tc_resource resource) { return plan->resources >> resource & 1; }

/* The one validator of scenes: TC_ERROR_UNSUPPORTED, TC_ERROR_INVALID or TC_ERROR_LIMIT with a pointer to the member that
 * cannot be rendered. valid: a scene over the same volume that passed before; lists shared with it are not checked again.
 * NULL: none. Pure. */
bool tc_plan_check(const tc_volume *volume, const tc_scene *scene, int width, int height, const tc_scene *valid,
                   GError **error);

#endif
