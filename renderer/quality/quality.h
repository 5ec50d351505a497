/* Quality control: the cheapest sampling whose error stays under a bound.
 *
 * The error of a frame (root mean square over pixels and channels, colour 0..1, see meter.h) falls with the step by a
 * power that depends on the look: 2 where all is smooth, less at jumps, 0 where a table or single precision is the limit.
 * No formula knows which, so it is measured: a picture of some hundred rays of this scene is rendered at a few
 * steps around the one that just holds the bound and compared with the reference; a power of the step is fitted to what
 * is found. A camera near a measured one shares its curve, one far from all takes the worst of them and a margin. Steps are rungs of 2^(1/8), so that neighbouring cameras share their tables.
 *
 * A model belongs to one look (everything of a scene but the camera, the image's size and sampling.step/termination)
 * and one bound. Plain data: zero-initialise; any thread, one at a time. */
#ifndef TC_QUALITY_QUALITY_H
#define TC_QUALITY_QUALITY_H

#include <stdatomic.h>
#include <stdbool.h>

#include "renderer/tomocast.h"

#define TC_QUALITY_VIEWS 24
#define TC_QUALITY_FINEST 0.0625 /* voxels */
#define TC_QUALITY_COARSEST 8.0

/* error(step) = rms * (step / .step)^order between finest and coarsest; measured errors lie off it by a factor of about
 * exp(spread), which is added to what is expected. */
typedef struct tc_quality_view {
  tc_camera camera;
  double step, rms, order, spread, finest, coarsest;
} tc_quality_view;

typedef struct tc_quality_model {
  int n, next; /* views there are; the one a new view replaces when all are taken */
  tc_quality_view views[TC_QUALITY_VIEWS];
} tc_quality_model;

typedef struct tc_quality_choice {
  double step;        /* voxels, for sampling.step */
  double termination; /* for sampling.termination: its error is far under the bound */
  double rms;         /* what the model expects; 0 before any measurement */
  bool holds;         /* the model expects the bound to hold */
  bool near;          /* by a view near this one */
  char reason[160];   /* one sentence */
} tc_quality_choice;

/* Why a scene has no error model, one phrase in `size` bytes; false: it can have one. Pure. */
bool tc_quality_refuses(const tc_scene *scene, char *reason, size_t size);

/* The choice for scene->camera under scene->quality.max_error. Pure. */
void tc_quality_choose(const tc_quality_model *model, const tc_scene *scene, tc_quality_choice *choice);
/* Puts it into the scene, and clears what asked for it. */
void tc_quality_apply(const tc_quality_choice *choice, tc_scene *scene);

/* The camera whose measurement would help most: the scene's own, then those around its target. False: enough is known. */
bool tc_quality_wants(const tc_quality_model *model, const tc_scene *scene, tc_camera *camera);

/* Measures one view of the scene as seen by `camera`, rendering with `renderer` (not the one that serves frames: this
 * takes tens to hundreds of milliseconds, on one thread). `model` says where to begin. TC_ERROR_CANCELLED when *cancel
 * (may be NULL) is set. */
bool tc_quality_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, const tc_camera *camera,
                        const tc_quality_model *model, const atomic_bool *cancel, tc_quality_view *view, GError **error);
void tc_quality_add(tc_quality_model *model, const tc_quality_view *view);

/* How unlike two cameras are: radians of the view, logarithm of the scale, shift in half heights, all added. */
double tc_quality_distance(const tc_camera *a, const tc_camera *b);

#endif
