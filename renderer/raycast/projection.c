#include "renderer/raycast/projection.h"

#include <math.h>

/* Bound of gain and offset: gain * voxel + offset stays finite, with voxels up to 1e30 (volume.h). */
#define LARGEST 1e30

bool tc_is_projection(tc_mode mode) { return mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE; }

static float clamped(double x) { return (float)fmin(fmax(x, -LARGEST), LARGEST); }

tc_grey tc_grey_make(const tc_volume *volume, const tc_scene *scene) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  double width = scene->window.width;
  double sign = (scene->mode == TC_MODE_MINIP) != (d->slope < 0) && scene->mode != TC_MODE_AVERAGE ? -1 : 1;
  double gain = sign * d->slope / width, offset = (d->intercept - scene->window.center) / width + 0.5;
  /* A window this narrow is a step function, which looks the same at any smaller scale. */
  if (!(fmax(fabs(gain), fabs(offset)) <= LARGEST)) {
    double middle = sign * (scene->window.center - d->intercept) / d->slope;
    gain = copysign(LARGEST / fmax(1, fabs(middle)), gain);
    offset = isfinite(middle) ? 0.5 - gain * middle : copysign(LARGEST, signbit(gain) ? middle : -middle);
  }
  /* w at grey 0 and at grey 1. `ease` moves stop, so that gain * w + offset reaches 0 or 1 in single precision too.
   * floor is not moved: in many volumes it is the value of air, and blocks of air must not lie above it. */
  double black = -offset / gain, white = (1 - offset) / gain;
  double ease = 1e-6 * (fabs(black) + fabs(white));
  double most = sign > 0 ? s->voxel_max : -s->voxel_min;
  return (tc_grey){.sign = (float)sign,
                   .gain = clamped(gain),
                   .offset = clamped(offset),
                   .floor = clamped(fmin(black, white)),
                   .stop = clamped(fmin(fmax(black, white) + ease, most))};
}
