/* Cost model of a frame: milliseconds per ray = a + b / spacing, fitted to rendered frames, recent ones weighted more.
 * a is the fixed cost of a ray; while all frames had one spacing, a is assumed to be a fixed share of b. spacing is the
 * distance of a ray's own samples, in voxels. In dvr the R rays of a pixel share its samples, which are R steps apart
 * on each ray (raycast/subpixel.h), so a pixel costs R a + b / step; the rays of a projection do not share samples.
 *
 * A segment of preintegrated2 takes `second` times as long as one of preintegrated and counts as so many, so that
 * frames of either method predict both.
 *
 * For steps finer than those of all frames, the whole time of a ray is assumed to grow with its samples: an upper
 * bound.
 *
 * A cost model belongs to one look on one machine. A frame that takes less than half or more than twice the expected
 * time starts a new look, and older frames are dropped. Plain data, from tc_quality_cost_of(); any thread, one at a
 * time. */
#ifndef TC_QUALITY_COST_H
#define TC_QUALITY_COST_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/scene/scene.h"

typedef struct tc_quality_cost {
  double second;          /* time of a segment of preintegrated2 relative to one of preintegrated */
  double spread;          /* variance of log(measured / expected time), exponentially smoothed */
  double most;            /* largest number of segments per voxel among the frames */
  double w, x, xx, y, xy; /* weighted sums; x = segments per voxel, y = ms per ray, weights 1 / y^2 */
} tc_quality_cost;

/* An empty model for frames of this back end (tc_renderer_info.backend). */
tc_quality_cost tc_quality_cost_of(const char *backend);

/* Spacing of a ray's samples relative to sampling.step: rays per pixel in dvr, else 1. */
double tc_quality_stretch(const tc_scene *scene);

/* Adds the time of a frame of `pixels` pixels (tc_estimate_pixels()) to the fit. Frames of modes without steps
 * (isosurface, mesh, splat) are ignored. */
void tc_quality_cost_add(tc_quality_cost *cost, const tc_scene *scene, double pixels, double ms);
/* Prediction of a final frame's time from the frame in motion before it: a view that takes longer is known before the
 * final frame begins. Zero-initialise. */
typedef struct tc_quality_pace {
  uint64_t revision; /* scene revision of the frame in motion */
  double slower;     /* its time over the time that the cost of final frames predicts; 0: none, or already used */
  double final;      /* the same ratio of final frames relative to that of the frames in motion before them, smoothed;
                        0: none */
  bool followed;     /* the cost of the newest final frame was corrected */
} tc_quality_pace;

/* Adds a frame; call before tc_quality_cost_add(). slower: its time over tc_quality_cost_ms() of the cost of final
 * frames; ignored unless finite and above 0. */
void tc_quality_pace_add(tc_quality_pace *pace, double slower, bool moving, uint64_t revision);
/* Before a final frame: corrects its cost by the frame in motion of that revision, if there was one. */
void tc_quality_pace_follow(tc_quality_pace *pace, tc_quality_cost *cost, uint64_t revision);

/* Expected milliseconds; 0 before any frame. */
double tc_quality_cost_ms(const tc_quality_cost *cost, const tc_scene *scene, double pixels);
/* The share of a bound on time to plan for, so that 19 of 20 frames keep the bound at the recent scatter of times. */
double tc_quality_cost_share(const tc_quality_cost *cost);
/* The finest step expected to take at most `ms` with the scene's classification, from spacings of 1/8 .. 4 voxels in
 * rungs of 2^(1/8); the coarsest if none does; a spacing of 1 before any frame. The scene's own step is not read. */
double tc_quality_cost_step(const tc_quality_cost *cost, const tc_scene *scene, double pixels, double ms);

#endif
