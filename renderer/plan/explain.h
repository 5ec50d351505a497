/* Text explanation of a plan: every stage of a frame, included or left out, with the reason. Formatted only on
 * request. */
#ifndef TC_PLAN_EXPLAIN_H
#define TC_PLAN_EXPLAIN_H

#include "renderer/plan/object_cost.h"
#include "renderer/plan/plan.h"

typedef enum tc_stage {
  TC_STAGE_COEFFICIENTS, /* B-spline coefficients in the voxels' place */
  TC_STAGE_TABLE_1D,     /* integrals T, K for approximate classification */
  TC_STAGE_TABLE_2D,     /* full pre-integration table */
  TC_STAGE_GRADIENT,     /* only if shaded */
  TC_STAGE_SKIPPING,     /* occupancy and distance map, only if something is empty */
  TC_STAGE_CLIPPING,
  TC_STAGE_RAYS,         /* several rays a pixel */
  TC_STAGE_COHERENCE,    /* rays of a pixel share one empty-space leap */
  TC_STAGE_JITTER,       /* the first segment's length differs from pixel to pixel */
  TC_STAGE_LABELS,
  TC_STAGE_TERMINATION,  /* early ray termination test in the loop */
  TC_STAGE_ALPHA,        /* alpha channel of the picture */
  TC_STAGE_DEPTH,        /* depth output */
  TC_STAGE_LINEAR_LIGHT, /* sRGB <-> linear conversion */
  TC_STAGE_RESOLVE,      /* background, 8-bit conversion */
  TC_STAGE_ENCODE,       /* image encoder */
  TC_STAGE_ERROR_METER,
  TC_STAGE_MESH,         /* extraction of triangles, in clusters */
  TC_STAGE_SPLATS,       /* an object's voxels as runs, and its surface as splats */
  TC_STAGE_COUNT
} tc_stage;

const char *tc_stage_name(tc_stage stage); /* "table-2d" ... */

typedef struct tc_explained_stage {
  bool included;
  char reason[400];
  double ms;      /* tc_render(): wall time in that frame; tc_renderer_explain(): build time of its cached resources,
                     else 0 */
  uint64_t bytes; /* memory of its resources */
} tc_explained_stage;

typedef struct tc_explanation {
  tc_plan_key key; /* of the kernel that runs */
  tc_explained_stage stages[TC_STAGE_COUNT];
  int width, height;
  double step_mm;            /* world length of a full segment */
  int table_size;            /* entries per side of the table, or nodes of the 1-D tables; 0 = none (projections) */
  int subtables;           /* narrower tables, for knots that are too close for the table's nodes */
  double table_lo, table_hi; /* values (volume's unit) of the first and last entry */
  bool has_object;           /* the scene is one opaque object (tc_is_object()), drawn by the cpu */
  tc_object_cost object;     /* expected cost in each mode that can draw it */
  bool object_measured;      /* the cost includes this machine's measured factors (frame/object_speed.h) */
  char kernel[64];           /* name of the variant that runs, e.g. "dvr.preintegrated.linear.u16.avx512" */
} tc_explanation;

/* Facts known only after a frame is drawn. */
typedef struct tc_facts {
  tc_plan_key key;           /* the key that ran: the plan's, or without skipping where too little was empty */
  bool fills_in;             /* the cpu draws, without skipping, until OpenGL is ready */
  double empty_share;        /* share of empty blocks; below 0: unknown */
  const char *table_builder; /* which processor computes the table, and why; NULL: no choice */
  const char *deaf;          /* the back end that cannot be interrupted in time, so that the cpu draws; else NULL ... */
  double deaf_ms, pixel_samples; /* ... milliseconds between its checks of the halt, and samples per pixel */
  size_t triangles, triangles_in_full; /* of the levels of detail drawn, and of the full mesh; 0 without levels */
  size_t clusters, outside, facing_away; /* of a mesh: clusters of the levels drawn, and of these the culled ones */
  bool nothing_in_view;      /* nothing is extracted or cut into clusters, since it is outside the view or clipped */
  uint64_t hidden, shaded;   /* tc_frame_stats, of a drawn frame; 0: unknown */
  bool culls_pixels;         /* gl drew the mesh: what is hidden is left out pixel by pixel, and not counted */
  const char *refused;       /* why the cpu draws a mode without rays instead of the back end; NULL: the back end
                                draws */
  double ms[TC_RESOURCE_COUNT];
  uint64_t bytes[TC_RESOURCE_COUNT];
} tc_facts;

/* The stage that a resource belongs to. */
tc_stage tc_stage_of(tc_resource resource);

/* facts: NULL before a frame. The kernel's name lacks the back end's suffix. Pure. */
void tc_plan_explain(const tc_plan *plan, const tc_volume *volume, const tc_scene *scene, const tc_facts *facts,
                     tc_explanation *explanation);

/* Adds the expected cost of the scene's object in each mode that can draw it, for scenes that the cpu draws. speed:
 * factors for tc_object_cost_scale(), or NULL. cancel: as for tc_object_cost_of(). Takes some milliseconds. */
void tc_explain_object(const tc_volume *volume, const tc_scene *scene, const double speed[TC_OBJECT_MODES],
                       const atomic_bool *cancel, tc_explanation *explanation);

/* Checks the scene, plans and explains, without a renderer. Pure. */
bool tc_explain(const tc_volume *volume, const tc_scene *scene, int width, int height, tc_explanation *explanation,
                GError **error);

/* True if the error meter (quality/meter.h) cannot measure the scene's frames; `reason` (of `size` bytes) then says why
 * in one phrase. Pure. */
bool tc_meter_refuses(const tc_scene *scene, char *reason, size_t size);

#endif
