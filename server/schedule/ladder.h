/* The quality ladder: how small an interactive frame must be to come in time.
 *
 * Render time is taken as proportional to pixels. The ladder keeps a smoothed estimate of milliseconds per pixel from
 * frames that were really rendered and picks the largest rung whose frame fits the target. Plain data, one thread. */
#ifndef TCS_SCHEDULE_LADDER_H
#define TCS_SCHEDULE_LADDER_H

#define TCS_LADDER_TARGET_MS 33.0

typedef struct tcs_ladder {
  double ms_per_pixel; /* smoothed; 0 = nothing measured yet */
  int rung;            /* index of the last pick; 0 = full size */
} tcs_ladder;          /* zero-initialised = start at full size */

/* Takes in a measured frame of `pixels` pixels that took `render_ms`. */
void tcs_ladder_measure(tcs_ladder *ladder, double pixels, double render_ms);

/* The scale of each side (1, 0.75, 0.5, 0.35 or 0.25) at which a frame comes within target_ms, for a picture that has
 * `full_pixels` at scale 1. Steps down at once, steps up only with a margin, so that it does not swing between two
 * rungs. */
double tcs_ladder_scale(tcs_ladder *ladder, double full_pixels, double target_ms);

#endif
