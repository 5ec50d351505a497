/* Clipping of a ray to the visible half spaces of the scene. */
#include <math.h>

#include "renderer/reference/internal.h"

static void add_half_space(tc_ref_clip *clip, double nx, double ny, double nz, double d) {
  double length = sqrt(nx * nx + ny * ny + nz * nz), *p = clip->planes[clip->n++];
  p[0] = nx / length, p[1] = ny / length, p[2] = nz / length, p[3] = d / length;
}

void tc_ref_clip_set_up(tc_ref_clip *clip, const tc_scene *scene) {
  const double(*box)[3] = scene->clip.box;
  clip->n = 0;
  if (scene->clip.has_box)
    for (int k = 0; k < 3; k++) {
      add_half_space(clip, k == 0, k == 1, k == 2, -box[0][k]);
      add_half_space(clip, -(k == 0), -(k == 1), -(k == 2), box[1][k]);
    }
  for (int i = 0; i < scene->clip.n_planes; i++) {
    const double *p = scene->clip.planes[i];
    add_half_space(clip, p[0], p[1], p[2], p[3]);
  }
}

bool tc_ref_clip_ray(const tc_ref_clip *clip, tc_ref_ray *ray) {
  for (int i = 0; i < clip->n; i++) {
    const double *p = clip->planes[i];
    double at = p[3], rate = 0;
    for (int k = 0; k < 3; k++) {
      at += p[k] * ray->lps[k];
      rate += p[k] * ray->lps_direction[k];
    }
    if (fabs(rate) < 1e-15) {
      if (at < 0) return false;
    } else if (rate > 0) {
      ray->enter = fmax(ray->enter, -at / rate);
    } else {
      ray->leave = fmin(ray->leave, -at / rate);
    }
  }
  return ray->enter < ray->leave;
}
