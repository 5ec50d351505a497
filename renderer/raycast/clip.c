#include "renderer/raycast/clip.h"

#include <math.h>

#include "renderer/base/vector.h"

/* An LPS plane n.p + d >= 0 in index coordinates, scaled so that its value is in mm. */
static void add_plane(tc_rays *rays, const tc_volume *volume, const double plane[4]) {
  const tc_volume_desc *desc = tc_volume_describe(volume);
  double length = sqrt(dot3(plane, plane)), *p = rays->planes[rays->n_planes++];
  for (int k = 0; k < 3; k++) {
    p[k] = 0;
    for (int r = 0; r < 3; r++) p[k] += plane[r] * desc->direction[3 * r + k] * desc->spacing[k] / length;
  }
  p[3] = (dot3(plane, desc->origin) + plane[3]) / length;
}

void tc_rays_add_clipping(tc_rays *rays, const tc_volume *volume, const tc_scene *scene) {
  for (int k = 0; k < 3 && scene->clip.has_box; k++) {
    double low[4] = {0, 0, 0, -scene->clip.box[0][k]}, high[4] = {0, 0, 0, scene->clip.box[1][k]};
    low[k] = 1, high[k] = -1;
    add_plane(rays, volume, low);
    add_plane(rays, volume, high);
  }
  for (int i = 0; i < scene->clip.n_planes; i++) add_plane(rays, volume, scene->clip.planes[i]);
}
