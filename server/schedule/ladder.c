#include "server/schedule/ladder.h"

#include <math.h>

enum { DETAIL = 1 }; /* the rung with coarser levels of detail of a mesh */
static const tcs_rung rungs[] = {{1.0, 1, 1},  {1.0, 1, 2},   {0.75, 1, 2},  {0.5, 1, 2},   {0.35, 1, 2},   {0.25, 1, 2},   {0.25, 2, 2},
                                 {0.25, 4, 2}, {0.177, 4, 2}, {0.125, 4, 2}, {0.088, 8, 2}, {0.0625, 8, 2}, {0.044, 16, 2}, {0.031, 16, 2}};
#define N_RUNGS ((int)(sizeof rungs / sizeof rungs[0]))

/* A step up must leave this margin, or the next noisy frame would step down again. */
#define UP_MARGIN 0.8
/* Weight of a new measurement. A slower frame counts in full at once, since late frames are visible; a faster one
 * counts gradually. */
#define FASTER_WEIGHT 0.3
/* Pixels that the encoder can take within about the target time. */
#define MOST_PIXELS 4e6
#define COARSEST_STEP 8.0
#define GAIN_EXPECTED 0.6 /* of coarser levels of detail, before it is measured */

void tcs_ladder_expect(tcs_ladder *ladder, double ms_per_sample) {
  if (!ladder->measured && ms_per_sample > 0) ladder->ms_per_sample = ms_per_sample;
}

/* Share of the time at full detail that a rung takes. */
static double gain_of(const tcs_ladder *ladder, int rung) {
  return rung < DETAIL || !ladder->has_levels ? 1 : ladder->gain > 0 ? ladder->gain : GAIN_EXPECTED;
}

void tcs_ladder_measure(tcs_ladder *ladder, double samples, double render_ms) {
  if (!(samples > 0) || !(render_ms >= 0) || !isfinite(samples)) return;
  double now = render_ms / samples;
  if (ladder->has_levels && ladder->rung == DETAIL && !ladder->gained && ladder->measured && ladder->ms_per_sample > 0) {
    ladder->gain = fmin(fmax(now / ladder->ms_per_sample, 0.05), 1), ladder->gained = true;
    return;
  }
  now /= gain_of(ladder, ladder->rung);
  if (!ladder->measured || now > ladder->ms_per_sample)
    ladder->ms_per_sample = now;
  else
    ladder->ms_per_sample += FASTER_WEIGHT * (now - ladder->ms_per_sample);
  ladder->measured = true;
}

tcs_rung tcs_ladder_pick(tcs_ladder *ladder, double samples, double pixels, double target_ms) {
  int fits = N_RUNGS - 1;
  for (int i = 0; i < N_RUNGS; i++) {
    const double area = rungs[i].scale * rungs[i].scale;
    const double ms = ladder->ms_per_sample * samples * area / rungs[i].coarser * gain_of(ladder, i);
    const bool up = i < ladder->rung;
    if (i == DETAIL && !ladder->has_levels) continue;
    if (pixels * area <= MOST_PIXELS && ms <= target_ms * (up ? UP_MARGIN : 1.0)) {
      fits = i;
      break;
    }
  }
  if (fits != ladder->rung) ladder->gained = false;
  ladder->rung = fits;
  return rungs[fits];
}

void tcs_rung_coarsen(int coarser, tc_scene *scene) {
  const int rays = scene->sampling.rays_per_pixel, fewer = rays > coarser ? rays / coarser : 1;
  const bool shared = scene->mode == TC_MODE_DVR;
  const double longer = shared ? coarser : (double)coarser * fewer / rays;
  if (coarser <= 1) return;
  scene->sampling.rays_per_pixel = fewer;
  if (longer > 1 && scene->mode != TC_MODE_ISOSURFACE && scene->mode != TC_MODE_MESH)
    scene->sampling.step =
        fmax(scene->sampling.step, fmin(COARSEST_STEP / (shared ? fewer : 1), scene->sampling.step * longer));
}
