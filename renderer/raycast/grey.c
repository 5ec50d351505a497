#include "renderer/raycast/grey.h"

#include <math.h>

/* Of gain and offset: their sum with a voxel (at most 1e30, volume.h) stays a number. */
#define LARGEST 1e30

bool tc_is_projection(tc_mode mode) {
  return mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE;
}

static float held(double x) { return (float)fmin(fmax(x, -LARGEST), LARGEST); }

tc_grey tc_grey_make(const tc_volume *volume, const tc_scene *scene) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  double width = scene->window.width;
  double sign = (scene->mode == TC_MODE_MINIP) != (d->slope < 0) && scene->mode != TC_MODE_AVERAGE ? -1 : 1;
  double gain = sign * d->slope / width, offset = (d->intercept - scene->window.center) / width + 0.5;
  /* So narrow a window is a step: the same one at any scale. */
  if (!(fmax(fabs(gain), fabs(offset)) <= LARGEST)) {
    double middle = sign * (scene->window.center - d->intercept) / d->slope;
    gain = copysign(LARGEST / fmax(1, fabs(middle)), gain);
    offset = isfinite(middle) ? 0.5 - gain * middle : copysign(LARGEST, signbit(gain) ? middle : -middle);
  }
  /* w at grey 0 and at grey 1; a finished ray is to be 0 or 1 in the single precision of gain * w + offset too. The
   * start is not moved: in many volumes it is the value of what is empty, and blocks of that are to be below it. */
  double black = -offset / gain, white = (1 - offset) / gain;
  double ease = 1e-6 * (fabs(black) + fabs(white));
  double most = sign > 0 ? s->voxel_max : -s->voxel_min;
  return (tc_grey){.sign = (float)sign,
                   .gain = held(gain),
                   .offset = held(offset),
                   .floor = held(fmin(black, white)),
                   .stop = held(fmin(fmax(black, white) + ease, most))};
}
