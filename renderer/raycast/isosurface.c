#include "renderer/raycast/isosurface.h"

#include <math.h>

#include "renderer/classify/preintegration.h"
#include "renderer/classify/transfer.h"

/* Relative to the largest |voxel - iso|: far above the error of interpolation in single precision. */
#define SLACK 0x1p-18

bool tc_is_surface(tc_mode mode) { return mode == TC_MODE_ISOSURFACE || mode == TC_MODE_MESH; }

bool tc_surface_exists(const tc_volume *volume, const tc_scene *scene) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  return scene->isosurface.value > s->min && scene->isosurface.value <= s->max;
}

/* The value as a stored voxel; exact if a voxel has that value, despite the rounding of slope and intercept. */
static double to_voxel(const tc_volume_desc *d, double value) {
  double v = (value - d->intercept) / d->slope, near = d->type == TC_F32 ? (double)(float)v : rint(v);
  return d->slope * near + d->intercept == value ? near : v;
}

tc_surface tc_surface_make(const tc_volume *volume, const tc_scene *scene) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  /* Beyond the range there is no surface: clamp, so that single precision holds. */
  double far = fmax(fabs(s->voxel_min), fabs(s->voxel_max)) + 1;
  double iso = fmin(fmax(to_voxel(d, scene->isosurface.value), -2 * far), 2 * far);
  double reach = fmax(fabs(s->voxel_min - iso), fabs(s->voxel_max - iso));
  tc_surface surface = {.iso = (float)iso, .below = iso - SLACK * reach, .above = iso + SLACK * reach};
  surface.scale = (float)copysign(fmin(1 / reach, 1e37), d->slope);
  /* Round iso away from inside, so that no voxel changes sides. */
  if (d->slope > 0 && (double)surface.iso < iso) surface.iso = nextafterf(surface.iso, INFINITY);
  if (d->slope < 0 && (double)surface.iso > iso) surface.iso = nextafterf(surface.iso, -INFINITY);
  for (int c = 0; c < 3; c++) {
    double color = scene->isosurface.color[c];
    surface.color[c] = (float)(scene->image.linear_light ? tc_srgb_to_linear(color) : color);
  }
  return surface;
}
