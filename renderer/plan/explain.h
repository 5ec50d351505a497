/* A plan in words, for whoever asks: every stage of a frame, in or out, with the reason. Nothing is formatted for frames
 * that nobody asks about. */
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
  TC_STAGE_MESH,         /* extraction of triangles, in clusters */
  TC_STAGE_SPLATS,       /* an object's voxels as runs, and its surface as splats */
  TC_STAGE_COUNT
} tc_stage;

const char *tc_stage_name(tc_stage stage); /* "table-2d" ... */

typedef struct tc_explained_stage {
  bool included;
  char reason[280];
  double ms;      /* tc_render(): wall time in that frame; tc_renderer_explain(): what building its parts took, 0 before */
  uint64_t bytes; /* memory held for it */
} tc_explained_stage;

typedef struct tc_explanation {
  tc_plan_key key; /* of what runs */
  tc_explained_stage stages[TC_STAGE_COUNT];
  int width, height;
  double step_mm;            /* world length of a full segment */
  int table_size;            /* entries per side of the table, or nodes of the 1-D tables; 0 = none (projections) */
  int subtables;           /* narrower tables that resolve knots which stand too close for it */
  double table_lo, table_hi; /* values (volume's unit) of the first and last entry */
  bool has_object;           /* the scene is an opaque object of a threshold, drawn by the cpu: */
  tc_object_cost object;     /* what it costs in each mode that draws it */
  bool object_measured;      /* by rates of this machine; until those are known, of the one they were fitted on */
  char kernel[64];           /* name of the variant that runs, e.g. "dvr.preintegrated.linear.u16.avx512" */
} tc_explanation;

/* What a frame found out, beside its plan. */
typedef struct tc_facts {
  tc_plan_key key;           /* of what runs: the plan's, or unskipped where leaping was no use */
  bool fills_in;             /* the cpu draws, every sample, while opengl gets ready */
  double empty_share;        /* of the blocks; below 0: not known */
  const char *table_builder; /* who makes the table's entries and why, where that is a choice; else NULL */
  const char *deaf;          /* the back end that could not be interrupted, so that the cpu draws; else NULL ... */
  double deaf_ms, pixel_samples; /* ... for so long, at a pixel of so many samples */
  size_t triangles, triangles_in_full; /* of a mesh that has levels of detail: drawn, and of the full one; else 0 */
  const char *refused;       /* why the cpu draws a mode without rays in the back end's place; NULL: it does not */
  double ms[TC_RESOURCE_COUNT];
  uint64_t bytes[TC_RESOURCE_COUNT];
} tc_facts;

/* The stage that a resource belongs to. */
tc_stage tc_stage_of(tc_resource resource);

/* facts: NULL before a frame. The kernel's name lacks the back end's words. Pure. */
void tc_plan_explain(const tc_plan *plan, const tc_volume *volume, const tc_scene *scene, const tc_facts *facts,
                     tc_explanation *explanation);

/* Adds what the scene's object would cost in each mode that draws it, to a plan that the cpu draws. speed: as for
 * tc_object_cost_of(). Some milliseconds. */
void tc_explain_object(const tc_volume *volume, const tc_scene *scene, const double speed[TC_OBJECT_MODES],
                       tc_explanation *explanation);

/* Checks the scene, plans and explains, without a renderer. Pure. */
bool tc_explain(const tc_volume *volume, const tc_scene *scene, int width, int height, tc_explanation *explanation,
                GError **error);

/* Why a scene's frames cannot be measured by the error meter (quality/meter.h), one
 * phrase in `size` bytes; false: they can be. Pure. */
bool tc_meter_refuses(const tc_scene *scene, char *reason, size_t size);

#endif
