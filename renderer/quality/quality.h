/* Quality control chooses the cheapest sampling whose error stays under a bound, or the sampling with the smallest
 * error that fits into a time.
 *
 * The error of a frame (root mean square over pixels and channels, colour 0..1, see meter.h) falls with the step by a
 * power that depends on the look: 3 or 2 in smooth fields, less at jumps, 0 where a table or single precision limits
 * the error. The power is measured: a picture of some thousand rays of this scene is rendered at a few steps around the
 * largest step that holds the bound (or the smallest that keeps the time) and compared with the reference; a power of
 * the step is fitted to these errors. A camera near a measured one uses that camera's curve; a camera far from all uses
 * the worst curve and a margin. Steps are rungs of 2^(1/8), so that neighbouring cameras share their tables.
 *
 * What is chosen: the step; the termination, whose error is kept far under the bound or the error expected; and, where
 * the scene's classification is preintegrated or preintegrated2, one of these two. Under a bound on the error the
 * method with the lower cost of segments (cost.h) is chosen, without measured times: one scene gives one picture. Under
 * a bound on time each method takes the finest step that keeps the time, and the present method stays unless the
 * other's error is clearly less, so that a moving camera does not alternate. Other classifications were asked for by
 * name and stay. So do the scene's rays per pixel, which smooth edges but do not reduce the error of sampling: with R
 * rays of a pixel `spacing` below, that of one ray's samples, is R steps (raycast/subpixel.h). The table's size follows
 * from the knots (classify/preintegration.h) and is part of what is measured.
 *
 * A model belongs to one look (everything of a scene but the camera, sampling.step/termination and, with one ray a
 * pixel, the image's size: how far apart a pixel's rays are counts) and one bound. Plain data: zero-initialise; any
 * thread, one at a time. */
#ifndef TC_QUALITY_QUALITY_H
#define TC_QUALITY_QUALITY_H

#include <stdatomic.h>
#include <stdbool.h>

#include "renderer/quality/cost.h"
#include "renderer/tomocast.h"

#define TC_QUALITY_VIEWS 24
#define TC_QUALITY_REASON 240 /* bytes */

/* error(spacing) = rms * (spacing / .spacing)^order for spacings from finest to coarsest, voxels. Measured errors
 * differ from the curve by a factor of about exp(spread), and expected errors include this factor. rms 0: not measured.
 */
typedef struct tc_quality_curve {
  double spacing, rms, order, spread, finest, coarsest;
} tc_quality_curve;

typedef enum tc_quality_method {
  TC_QUALITY_FIRST, /* preintegrated, or whatever the scene has that is not preintegrated2 */
  TC_QUALITY_SECOND, /* preintegrated2 */
  TC_QUALITY_METHODS
} tc_quality_method;

typedef struct tc_quality_view {
  tc_camera camera;
  tc_quality_curve of[TC_QUALITY_METHODS];
} tc_quality_view;

typedef struct tc_quality_model {
  int n, next; /* number of views; index of the view to replace when all are in use */
  tc_quality_view views[TC_QUALITY_VIEWS];
} tc_quality_model;

typedef struct tc_quality_choice {
  tc_classification classification;
  double step;        /* voxels, for sampling.step */
  double termination; /* for sampling.termination */
  double rms;         /* the error that the model expects; 0 before any measurement */
  double ms;          /* the time; 0 before any frame was timed */
  bool holds;         /* the bound is expected to hold */
  bool near;          /* by a view near this one */
  char reason[TC_QUALITY_REASON]; /* one sentence */
} tc_quality_choice;

/* True if nothing can be chosen for the scene's bound; `reason` (of `size` bytes) then says why in one phrase.
 * Pure. */
bool tc_quality_refuses(const tc_scene *scene, char *reason, size_t size);
/* Whether the choice needs measured views. Under max_error it always does. Under max_ms it does where there are two
 * methods to choose from and a frame was timed (which gives the step to measure around); else time alone sets the step.
 * Pure. */
bool tc_quality_measures(const tc_quality_cost *cost, const tc_scene *scene);

/* The error that the model expects of a sampling of the scene as its camera sees it; INFINITY where it cannot say.
 * Pure. */
double tc_quality_expects(const tc_quality_model *model, const tc_scene *scene, tc_classification classification,
                          double step);
/* The choice for scene->camera under scene->quality, max_error or max_ms for a frame of `pixels`, as the cost counts
 * them. cost: of such frames; max_error asks it for the weight of the methods only. Under max_ms scene->classification is the method in
 * use. Pure. */
void tc_quality_choose(const tc_quality_model *model, const tc_quality_cost *cost, const tc_scene *scene, double pixels,
                       tc_quality_choice *choice);
/* Whether to render a finished picture (of `classification` and `step`) again with the present choice: the picture breaks
 * its bound, or the same time allows a clearly smaller error. Pure. */
bool tc_quality_betters(const tc_quality_model *model, const tc_scene *scene, const tc_quality_choice *choice,
                        tc_classification classification, double step);
/* Puts it into the scene, and clears what asked for it. */
void tc_quality_apply(const tc_quality_choice *choice, tc_scene *scene);

/* The camera whose measurement would help most: the scene's own, then those around its target. False: enough is
 * known. */
bool tc_quality_wants(const tc_quality_model *model, const tc_scene *scene, tc_camera *camera);

typedef struct tc_quality_subject {
  tc_volume *volume, *labels; /* labels: as in tc_meter_subject */
  const tc_scene *scene;
  const tc_camera *camera; /* instead of the scene's */
  const tc_quality_model *model;
  const tc_quality_cost *cost;   /* with the model: where to begin */
  const tc_interrupt *interrupt; /* NULL: never */
} tc_quality_subject;

/* Measures one view of the scene, rendering with `renderer` (not the one that serves frames: this takes tens to hundreds
 * of milliseconds, on one thread). TC_ERROR_CANCELLED when the interrupt asks; it does not pause. */
bool tc_quality_measure(tc_renderer *renderer, const tc_quality_subject *of, tc_quality_view *view, GError **error);
void tc_quality_add(tc_quality_model *model, const tc_quality_view *view);

/* How unlike two cameras are: radians of the view, logarithm of the scale, shift in half heights, all added. */
double tc_quality_distance(const tc_camera *a, const tc_camera *b);

#endif
