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
 * Quality control chooses the step; the early ray termination, whose error is kept far below the bound or the expected
 * error; and, if the scene's classification is preintegrated or preintegrated2, one of these two methods. Under a bound
 * on the error it chooses the method with the lower cost of segments (cost.h), without measured times, so that one
 * scene gives one picture. Under a bound on time each method takes the finest step that keeps the time, and the method
 * in use stays unless the other's error is clearly smaller, so that a moving camera does not alternate. Other
 * classifications are kept, and so are the scene's rays per pixel: they antialias but do not reduce the error of
 * sampling. With R rays per pixel, `spacing` below (the distance of one ray's samples) is R steps (raycast/subpixel.h).
 * The table's size follows from the knots (classify/preintegration.h) and enters the measured errors.
 *
 * A model belongs to one bound and one look: the scene without camera, sampling.step, sampling.termination and, with
 * one ray per pixel, the image's size (with several, the size determines the distance of a pixel's rays). Plain data:
 * zero-initialise; any thread, one at a time. */
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
  TC_QUALITY_FIRST, /* preintegrated, or the scene's classification other than these two */
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
  double rms;         /* expected error; 0 before any measurement */
  double ms;          /* expected time; 0 before any frame was timed */
  bool holds;         /* the bound is expected to hold */
  bool near;          /* the expected error comes from views near this one */
  char reason[TC_QUALITY_REASON]; /* one sentence */
} tc_quality_choice;

/* True if nothing can be chosen for the scene's bound; `reason` (of `size` bytes) then says why in one phrase.
 * Pure. */
bool tc_quality_refuses(const tc_scene *scene, char *reason, size_t size);
/* True if the choice needs measured views: always under max_error; under max_ms if there are two methods to choose from
 * and a frame was timed (which gives the step to measure around), else time alone sets the step. Pure. */
bool tc_quality_measures(const tc_quality_cost *cost, const tc_scene *scene);

/* The expected error of the scene with this classification and step, for its camera; INFINITY if unknown. Pure. */
double tc_quality_expects(const tc_quality_model *model, const tc_scene *scene, tc_classification classification,
                          double step);
/* The choice for scene->camera under the bound of scene->quality, max_error or max_ms. pixels: tc_estimate_pixels() of
 * the frame; cost: of such frames (max_error reads only the relative cost of the methods). Under max_ms
 * scene->classification is the method in use. Pure. */
void tc_quality_choose(const tc_quality_model *model, const tc_quality_cost *cost, const tc_scene *scene, double pixels,
                       tc_quality_choice *choice);
/* True if a finished picture (of `classification` and `step`) should be rendered again with the present choice: the
 * picture breaks its bound, or the same time allows a clearly smaller error. Pure. */
bool tc_quality_betters(const tc_quality_model *model, const tc_scene *scene, const tc_quality_choice *choice,
                        tc_classification classification, double step);
/* Writes the choice into the scene and clears the scene's bounds. */
void tc_quality_apply(const tc_quality_choice *choice, tc_scene *scene);

/* The next camera to measure: the scene's own, then cameras around its target. False: enough views are known. */
bool tc_quality_wants(const tc_quality_model *model, const tc_scene *scene, tc_camera *camera);

typedef struct tc_quality_subject {
  tc_volume *volume, *labels; /* labels: as in tc_meter_subject */
  const tc_scene *scene;
  const tc_camera *camera; /* used instead of the scene's */
  const tc_quality_model *model;
  const tc_quality_cost *cost;   /* gives, with the model, the first spacing to try */
  const tc_interrupt *interrupt; /* NULL: never */
} tc_quality_subject;

/* Measures one view of the scene, rendering with `renderer` (not the one that serves frames, since a measurement takes
 * tens to hundreds of milliseconds on one thread). TC_ERROR_CANCELLED if interrupt->cancel is set; pauses are
 * ignored. */
bool tc_quality_measure(tc_renderer *renderer, const tc_quality_subject *of, tc_quality_view *view, GError **error);
void tc_quality_add(tc_quality_model *model, const tc_quality_view *view);

/* Distance of two cameras: sum of the angle between their views in radians, the logarithm of the ratio of scales, the
 * shift in half heights of the picture, and the difference in projection. */
double tc_quality_distance(const tc_camera *a, const tc_camera *b);

#endif
