/* The quality ladder: size and sampling at which an interactive frame meets its target time.
 *
 * Render time is assumed proportional to samples (tc_estimate_samples()). The ladder keeps a smoothed estimate of
 * milliseconds per sample from rendered frames, starting from that of other sessions, and picks the highest rung whose
 * frame meets the target: first smaller pictures; below the smallest of those, fewer samples per pixel and smaller
 * pictures still. The view stays the same. Plain data, one thread.
 *
 * Smaller pictures come first because of measurements (1920x1080, lit, against a quarter of the step; a CT head, the
 * built-in head, an aneurysm). Half the side length takes .26 to .30 of the samples at 1.0 to 1.3 times the error of
 * the full frame, with the brightness within .1 of 255. Twice the step takes .55 to .60 of the samples at 1.8 to 2.1
 * times the error, and darkens thin structures by up to 9 of 255, which would show as a jump in brightness.
 *
 * A mesh (mode mesh) first takes coarser levels of detail, off by up to two pixels: half as many triangles of a surface of two or
 * seven million at 512x512, at no loss of pixels. What that gains is measured each time the ladder comes to that rung: where
 * pixels take the time and not triangles, it goes on to smaller pictures. */
#ifndef TCS_SCHEDULE_LADDER_H
#define TCS_SCHEDULE_LADDER_H

#include <stdbool.h>

#include "renderer/scene/scene.h"

#define TCS_LADDER_TARGET_MS 33.0

typedef struct tcs_ladder {
  double ms_per_sample; /* smoothed; 0 = unknown */
  bool measured;        /* by this ladder's own frames */
  int rung;             /* index of the last pick; 0 = full size */
  bool has_levels;      /* mode mesh: the rung with coarser levels of detail is taken, too */
  bool gained;          /* that rung's gain is measured since the ladder came to it */
  double gain;          /* share of the time that it takes; 0 = unknown */
} tcs_ladder;           /* zero-initialised = start at full size */

typedef struct tcs_rung {
  double scale; /* of each side length */
  int coarser;  /* factor by which the samples per pixel are reduced */
  int detail;   /* factor on the error that a mesh's levels of detail may have (tc_render_request) */
} tcs_rung;

/* Initial estimate, from other frames, until the first own frame is measured. 0 is ignored. */
void tcs_ladder_expect(tcs_ladder *ladder, double ms_per_sample);
/* Adds a measurement: a frame of `samples` estimated samples took `render_ms`. */
void tcs_ladder_measure(tcs_ladder *ladder, double samples, double render_ms);

/* Picks the rung at which a frame of `samples` and `pixels` at full size meets target_ms, within what the encoder can
 * take. Steps down at once, but up only with a margin, so that it does not oscillate between two rungs. */
tcs_rung tcs_ladder_pick(tcs_ladder *ladder, double samples, double pixels, double target_ms);

/* Reduces the samples per pixel: first fewer rays, then larger steps. In mode dvr the rays of a pixel share its
 * samples, so that only the step reduces them. Isosurfaces and meshes have no step. */
void tcs_rung_coarsen(int coarser, tc_scene *scene);

#endif
