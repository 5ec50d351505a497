/* What a frame costs: milliseconds per ray = a + b / spacing, fitted to frames that were rendered, later ones counting
 * more. a is what a ray costs before its first sample; while all frames had one spacing it is taken as a fixed share.
 * spacing is that of a ray's own samples, in voxels: R rays of a pixel that composite share its samples and have them R
 * steps apart (raycast/subpixel.h), so they cost R a + b / step; the rays of a projection share none.
 *
 * A segment of preintegrated2 takes `second` times as long as one of preintegrated, and counts as so many: frames of
 * either method tell of both.
 *
 * Steps finer than any of the frames count as if all of a ray's time were its samples': an upper bound.
 *
 * A cost belongs to one look on one machine; a frame that took less than half or more than twice the expected time starts
 * a new look, and older frames are forgotten. Plain data, from tc_quality_cost_of(); any thread, one at a time. */
#ifndef TC_QUALITY_COST_H
#define TC_QUALITY_COST_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/scene/scene.h"

typedef struct tc_quality_cost {
  double second;          /* a segment of preintegrated2 beside one of preintegrated, in time */
  double spread;          /* smoothed square of the logarithm of measured over expected time */
  double most;            /* the most segments a voxel of the frames */
  double w, x, xx, y, xy; /* weighted sums; x = segments a voxel, y = ms per ray, weights relative to y */
} tc_quality_cost;

/* Nothing known yet, of frames of this back end (tc_renderer_info.backend). */
tc_quality_cost tc_quality_cost_of(const char *backend);

/* The voxels between a ray's samples at a step of 1: what sampling.step is multiplied by. */
double tc_quality_stretch(const tc_scene *scene);

/* Takes in a frame of `pixels` pixels of the scene, as tc_estimate_pixels() counts them where the camera moves. An
 * isosurface has no steps: it is not taken in. */
void tc_quality_cost_add(tc_quality_cost *cost, const tc_scene *scene, double pixels, double ms);
/* What a frame in motion tells of the final one of the same scene: a view that takes longer is known before that one is
 * begun. Zero-initialise. */
typedef struct tc_quality_pace {
  uint64_t revision; /* of the frame in motion */
  double slower;     /* its time over what the cost of final frames expects of it; 0: none, or taken */
  double final;      /* the same of final frames, over that of the frames in motion before them: smoothed; 0: none yet */
  bool followed;     /* the newest final frame was foretold so */
} tc_quality_pace;

/* Takes in a frame before the cost of final frames does. slower: its time over tc_quality_cost_ms() of final frames;
 * nothing where that was not known. */
void tc_quality_pace_add(tc_quality_pace *pace, double slower, bool moving, uint64_t revision);
/* Before a final frame: its cost follows the frame in motion of that revision, if there was one. */
void tc_quality_pace_follow(tc_quality_pace *pace, tc_quality_cost *cost, uint64_t revision);

/* Expected milliseconds; 0 while nothing is known. */
double tc_quality_cost_ms(const tc_quality_cost *cost, const tc_scene *scene, double pixels);
/* The share of a bound on time to plan for, so that 19 of 20 frames hold it while their times scatter as of late. */
double tc_quality_cost_share(const tc_quality_cost *cost);
/* The finest step (of a spacing of 1/8 .. 4 voxels in rungs of 2^(1/8)) expected to take at most `ms` with the
 * scene's classification; the coarsest where none does, a spacing of 1 while nothing is known. The scene's own step is
 * not read. */
double tc_quality_cost_step(const tc_quality_cost *cost, const tc_scene *scene, double pixels, double ms);

#endif
