#include "renderer/raycast/rays.h"

#include <math.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/raycast/clip.h"
#include "renderer/raycast/mpr.h"

/* Centre and radius of the volume's box in LPS. */
static void bounding_sphere(const tc_volume *volume, double center[3], double *radius) {
  double lo[3], hi[3], mid[3], corner[3], p[3];
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) mid[k] = 0.5 * (lo[k] + hi[k]);
  tc_volume_index_to_lps(volume, mid, center);
  *radius = 0;
  for (int c = 0; c < 8; c++) {
    for (int k = 0; k < 3; k++) corner[k] = c >> k & 1 ? hi[k] : lo[k];
    tc_volume_index_to_lps(volume, corner, p);
    double d2 = 0;
    for (int k = 0; k < 3; k++) d2 += (p[k] - center[k]) * (p[k] - center[k]);
    *radius = fmax(*radius, sqrt(d2));
  }
}

double tc_rays_step_mm(const tc_volume *volume, const tc_scene *scene) {
  const double *spacing = tc_volume_describe(volume)->spacing;
  int share = scene->mode == TC_MODE_DVR ? scene->sampling.rays_per_pixel : 1;
  return scene->sampling.step * share * fmin(spacing[0], fmin(spacing[1], spacing[2]));
}

/* Bound on the distance of a pixel's rays (tc_rays.footprint). On the anchor plane, `depth` from the eye, two rays of a
 * pixel are at most d apart. At s mm from the plane, p(s) = anchor + s * dir differs by at most d * (1 + |s| / |view|),
 * where |s| / |view| is the depth of the point relative to the anchor plane's. */
static double footprint(const tc_rays *rays, const tc_volume *volume, const tc_camera *camera, const double forward[3],
                        double depth, double pixel_mm) {
  double apart = 0, spread = 0, fastest = 0;
  for (int r = 0; r < rays->count; r++) apart = fmax(apart, hypot(rays->of_pixel[r].x, rays->of_pixel[r].y) * pixel_mm);
  for (int c = 0; c < 8; c++) {
    double index[3], p[3];
    for (int k = 0; k < 3; k++) index[k] = c >> k & 1 ? rays->hi[k] : rays->lo[k];
    tc_volume_index_to_lps(volume, index, p);
    for (int k = 0; k < 3; k++) p[k] -= camera->position[k];
    spread = fmax(spread, fabs(fmax(dot3(p, forward), 0) / depth - 1));
  }
  for (int k = 0; k < 3; k++) fastest = fmax(fastest, sqrt(dot3(rays->to_index + 3 * k, rays->to_index + 3 * k)));
  if (!rays->perspective) return apart * fastest;
  /* The extra tenth covers the difference of |view| between the two rays. */
  return apart <= 0.1 * depth ? apart * (1 + 1.1 * spread) * fastest : INFINITY;
}

void tc_rays_set_up(tc_rays *rays, const tc_volume *volume, const tc_scene *scene, int width, int height) {
  if (scene->mode == TC_MODE_MPR) {
    tc_slice_rays(rays, volume, scene, width, height);
    rays->count = 1;
    tc_subpixel_rays(1, rays->of_pixel);
    return;
  }
  const tc_camera *camera = &scene->camera;
  double forward[3], right[3], up[3], center[3], radius;
  for (int k = 0; k < 3; k++) forward[k] = camera->target[k] - camera->position[k];
  normalise3(forward);
  cross3(forward, camera->up, right);
  normalise3(right);
  cross3(right, forward, up);
  bounding_sphere(volume, center, &radius);

  memset(rays, 0, sizeof *rays);
  rays->width = width, rays->height = height;
  tc_volume_lps_to_index_matrix(volume, rays->to_index);
  tc_volume_index_box(volume, rays->lo, rays->hi);
  rays->perspective = camera->projection == TC_PERSPECTIVE;
  rays->far_mm = TC_RAYS_FAR_MM;
  rays->step_mm = tc_rays_step_mm(volume, scene);
  rays->count = scene->sampling.rays_per_pixel;
  tc_subpixel_rays(rays->count, rays->of_pixel);

  tc_rays_add_clipping(rays, volume, scene);

  double to_center[3];
  for (int k = 0; k < 3; k++) to_center[k] = center[k] - camera->position[k];
  double depth = dot3(to_center, forward);
  /* Perspective needs an anchor plane in front of the eye. With the eye inside the volume, a quarter of the radius
   * keeps the plane at the volume's scale. */
  if (rays->perspective) depth = fmax(depth, 0.25 * radius);
  double half_height = rays->perspective ? depth * tan(camera->fov_y_deg * (M_PI / 360)) : 0.5 * camera->height_mm;
  double pixel = 2 * half_height / height;

  double anchor[3], du[3], dv[3];
  for (int k = 0; k < 3; k++) {
    du[k] = pixel * right[k];
    dv[k] = -pixel * up[k];
    anchor[k] = camera->position[k] + depth * forward[k] - 0.5 * width * du[k] - 0.5 * height * dv[k];
  }
  rays->footprint = footprint(rays, volume, camera, forward, depth, pixel);
  tc_volume_lps_to_index(volume, anchor, rays->anchor0);
  for (int r = 0; r < 3; r++) {
    rays->anchor_du[r] = dot3(rays->to_index + 3 * r, du);
    rays->anchor_dv[r] = dot3(rays->to_index + 3 * r, dv);
  }
  if (rays->perspective) {
    for (int k = 0; k < 3; k++) {
      rays->view0[k] = depth * forward[k] - 0.5 * width * du[k] - 0.5 * height * dv[k];
      rays->view_du[k] = du[k];
      rays->view_dv[k] = dv[k];
    }
  } else {
    memcpy(rays->view0, forward, sizeof forward);
    rays->eye_mm = depth;
  }
}

static void round_values(float *to, const double *from, int count) {
  for (int i = 0; i < count; i++) to[i] = (float)from[i];
}

void tc_rays_round(tc_rays_single *to, const tc_rays *rays) {
  *to = (tc_rays_single){.step_mm = (float)rays->step_mm,
                         .inverse_step = (float)(1 / rays->step_mm),
                         .eye_mm = (float)rays->eye_mm,
                         .far_mm = (float)rays->far_mm,
                         .n_planes = rays->n_planes,
                         .count = rays->count,
                         .perspective = rays->perspective,
                         .footprint = (float)fmin(rays->footprint, 1e9)};
  round_values(to->anchor0, rays->anchor0, 3);
  round_values(to->anchor_du, rays->anchor_du, 3);
  round_values(to->anchor_dv, rays->anchor_dv, 3);
  round_values(to->view0, rays->view0, 3);
  round_values(to->view_du, rays->view_du, 3);
  round_values(to->view_dv, rays->view_dv, 3);
  round_values(to->lo, rays->lo, 3);
  round_values(to->hi, rays->hi, 3);
  for (int r = 0; r < 3; r++) round_values(to->to_index[r], rays->to_index + 3 * r, 3);
  for (int i = 0; i < rays->n_planes; i++) round_values(to->planes[i], rays->planes[i], 4);
  for (int i = 0; i < rays->count; i++) {
    const tc_subpixel *ray = &rays->of_pixel[i];
    to->of_pixel[i] = (tc_subpixel_single){(float)ray->x, (float)ray->y, (float)ray->phase, 0};
  }
}
