/* The quality ladder: how small and coarse an interactive frame must be to come in time.
 *
 * Render time is taken as proportional to samples (tc_estimate_samples()). The ladder keeps a smoothed estimate of
 * milliseconds per sample from frames that were really rendered, begins with one of other sessions' frames, and picks
 * the highest rung whose frame fits the target: first smaller pictures; where the smallest of those does not fit, fewer
 * samples a pixel and pictures smaller still. The view stays the same. Plain data, one thread.
 *
 * Smaller pictures come first, by measurement (1920x1080, lit, against a quarter of the step; a CT head, the built-in
 * one, an aneurysm): half the sides take .26 to .30 of the samples, and their error is 1.0 to 1.3 times that of the full
 * frame, as bright to within .1 of 255; twice the step takes .55 to .60, its error is 1.8 to 2.1 times as large, and
 * pictures of thin things darken by up to 9 of 255: brightness would jump. */
#ifndef TCS_SCHEDULE_LADDER_H
#define TCS_SCHEDULE_LADDER_H

#include <stdbool.h>

#include "renderer/scene/scene.h"

#define TCS_LADDER_TARGET_MS 33.0

typedef struct tcs_ladder {
  double ms_per_sample; /* smoothed; 0 = nothing is known yet */
  bool measured;        /* by a frame of its own */
  int rung;             /* index of the last pick; 0 = full size */
} tcs_ladder;           /* zero-initialised = start at full size */

typedef struct tcs_rung {
  double scale; /* of each side */
  int coarser;  /* a pixel is to take so many times fewer samples */
} tcs_rung;

/* What a sample takes elsewhere, until the first frame is measured. 0 is fine. */
void tcs_ladder_expect(tcs_ladder *ladder, double ms_per_sample);
/* Takes in a measured frame that took `render_ms` for what was estimated as `samples`. */
void tcs_ladder_measure(tcs_ladder *ladder, double samples, double render_ms);

/* The rung at which a frame comes within target_ms whose full size takes `samples` and has `pixels`: what the encoder
 * can take counts too. Steps down at once, steps up only with a margin, so that it does not swing between two rungs. */
tcs_rung tcs_ladder_pick(tcs_ladder *ladder, double samples, double pixels, double target_ms);

/* Fewer samples a pixel: rays as far as there are any, then steps. Rays of dvr share a pixel's samples, so that there
 * it is its steps alone that count; a surface has no steps. */
void tcs_rung_coarsen(int coarser, tc_scene *scene);

#endif
