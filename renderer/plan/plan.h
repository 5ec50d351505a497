/* The render plan: the one place that decides what a frame needs, and the key of every kernel and shader variant.
 *
 * Plain values computed from scene + volume. Stages are listed with a reason whether in or out.
 *
 * The projections (mip, minip, average) see the field through the window alone: transferFunction, classification,
 * order, shading and sampling.termination have no meaning for them; they are neither read nor refused, and are 0 in the
 * key.
 *
 * An isosurface (raycast/surface.h) reads isosurface and shading: it has no transfer function, no window and no steps.
 * A value that no place of the volume has is an empty picture, and the gradient stage says so. */
#ifndef TC_RENDERER_PLAN_H
#define TC_RENDERER_PLAN_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/classify/classify.h"
#include "renderer/error.h"
#include "renderer/scene.h"
#include "renderer/volume/volume.h"

typedef enum tc_stage {
  TC_STAGE_COEFFICIENTS, /* B-spline coefficients in the voxels' place */
  TC_STAGE_TABLE_1D,     /* integrals T, K for approximate classification */
  TC_STAGE_TABLE_2D,     /* full pre-integration table */
  TC_STAGE_GRADIENT,     /* only if shaded */
  TC_STAGE_SKIPPING,     /* occupancy and distance map, only if something is empty */
  TC_STAGE_CLIPPING,
  TC_STAGE_RAYS,         /* several rays a pixel */
  TC_STAGE_COHERENCE,    /* rays of a pixel share what is known of the empty space before them */
  TC_STAGE_JITTER,       /* the first segment's length differs from pixel to pixel */
  TC_STAGE_LABELS,
  TC_STAGE_TERMINATION,  /* early ray termination test in the loop */
  TC_STAGE_ALPHA,        /* alpha channel of the picture */
  TC_STAGE_DEPTH,        /* depth output */
  TC_STAGE_LINEAR_LIGHT, /* sRGB <-> linear conversion */
  TC_STAGE_RESOLVE,      /* background, 8-bit conversion */
  TC_STAGE_ENCODE,       /* image encoder */
  TC_STAGE_ERROR_METER,
  TC_STAGE_COUNT
} tc_stage;

const char *tc_stage_name(tc_stage stage); /* "table-2d" ... */

typedef struct tc_plan_stage {
  bool included;
  char reason[200];
  double ms;      /* tc_render(): wall time in that frame; tc_renderer_plan(): what building its parts took, 0 before */
  uint64_t bytes; /* memory held for it */
} tc_plan_stage;

/* What kernels are specialised on. Two plans with equal keys run the same code. Zeroed before filling: compare with
 * memcmp. */
typedef struct tc_plan_key {
  uint8_t mode;           /* tc_mode */
  uint8_t voxel_type;     /* tc_voxel_type of what is sampled: coefficients are f32 */
  uint8_t classification; /* tc_classification */
  uint8_t order;          /* tc_order */
  uint8_t filter;         /* tc_filter */
  uint8_t projection;     /* tc_projection */
  uint8_t shading;        /* tc_shading_model */
  uint8_t gradient;       /* tc_gradient; 0 unless shaded */
  uint8_t termination;    /* 0/1 */
  uint8_t skipping;       /* 0/1 */
  uint8_t clipping;       /* 0/1 */
  uint8_t rays;           /* 0/1: several a pixel */
  uint8_t coherence;      /* 0/1 */
  uint8_t jitter;         /* 0/1 */
  uint8_t labels;         /* 0/1: of a label volume, in a mode that shows it */
  uint8_t zoomed;         /* 0/1: the pre-integration table has zooms (classify/classify.h) */
  uint8_t stiff;          /* 0/1: a ray's short last segment needs the table's row of depths (classify/classify.h) */
  uint8_t slab;           /* mpr: 0 one slice, else 1 + tc_slab_projection */
} tc_plan_key;

typedef struct tc_plan {
  tc_plan_key key;
  tc_plan_stage stages[TC_STAGE_COUNT];
  int width, height;
  double step_mm;       /* world length of a full segment */
  int table_size;       /* entries per side of the table, or nodes of the 1-D tables; 0 = none (projections) */
  int table_zooms;      /* narrower tables that resolve knots which stand too close for it */
  double table_lo, table_hi; /* values (volume's unit) of the first and last entry */
  tc_table_params table; /* mode dvr: what the table or the integrals are made with, but for .tf, which is the scene's */
  char kernel[64];      /* name of the variant that runs, e.g. "dvr.preintegrated.linear.u16.avx512" */
} tc_plan;

/* What a key's variants are called: "dvr.preintegrated.linear.shaded.u16"; back ends add their own words. */
void tc_plan_key_name(const tc_plan_key *key, char *name, size_t size);

/* Chooses the table anew, over what is sampled in the volume's place. nodes: as asked for, without zooms; 0: as many as
 * the scene wants. */
void tc_plan_table(tc_plan *plan, const tc_volume *field, const tc_scene *scene, int nodes);

/* Takes leaping out, and what depends on it; reason: of the skipping stage. */
void tc_plan_drop_skipping(tc_plan *plan, const char *reason);

/* Computes the plan, or says (TC_ERROR_UNSUPPORTED / TC_ERROR_INVALID with a pointer) what cannot be rendered. Pure. */
bool tc_plan_make(const tc_volume *volume, const tc_scene *scene, int width, int height, tc_plan *plan, GError **error);

/* What tc_plan_make() would say, without a plan: cheap. valid: a scene over the same volume that passed, whose shared
 * lists need no second look; NULL: none. Pure. */
bool tc_plan_check(const tc_volume *volume, const tc_scene *scene, int width, int height, const tc_scene *valid,
                   GError **error);

#endif
