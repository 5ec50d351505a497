/* From the camera to a ray, and its part inside the field's box (NUMERICS section 0). */
#include <math.h>

#include "renderer/reference/internal.h"

static long double dot(const long double a[3], const long double b[3]) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const long double a[3], const long double b[3], long double c[3]) {
  for (int k = 0; k < 3; k++) c[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static bool normalise(long double v[3]) {
  long double length = sqrtl(dot(v, v));
  if (!isfinite(length) || !(length > 0)) return false;
  for (int k = 0; k < 3; k++) v[k] /= length;
  return true;
}

const char *tc_ref_camera_set_up(tc_ref_camera *camera, const tc_camera *from, int width, int height) {
  long double up[3];
  for (int k = 0; k < 3; k++) {
    camera->position[k] = from->position[k];
    camera->forward[k] = (long double)from->target[k] - from->position[k];
    up[k] = from->up[k];
  }
  for (int k = 0; k < 3; k++)
    if (!isfinite(from->position[k])) return "/camera/position";
  if (!normalise(camera->forward)) return "/camera/target";
  if (!normalise(up)) return "/camera/up";
  cross(camera->forward, up, camera->right);
  if (sqrtl(dot(camera->right, camera->right)) < 1e-12L || !normalise(camera->right)) return "/camera/up";
  cross(camera->right, camera->forward, camera->up);
  camera->perspective = from->projection == TC_PERSPECTIVE;
  if (camera->perspective) {
    if (!(from->fov_y_deg > 0 && from->fov_y_deg < 180)) return "/camera/fovY";
    camera->half_height = tanl(from->fov_y_deg * (3.141592653589793238462643L / 360));
  } else {
    if (!(from->height_mm > 0) || !isfinite(from->height_mm)) return "/camera/height";
    camera->half_height = from->height_mm / 2.0L;
  }
  camera->half_width = camera->half_height * width / height;
  camera->width = width;
  camera->height = height;
  return NULL;
}

static void eye_ray(const tc_ref_camera *camera, double px, double py, long double eye[3], long double direction[3]) {
  long double x = (2.0L * px / camera->width - 1) * camera->half_width;
  long double y = (1 - 2.0L * py / camera->height) * camera->half_height;
  for (int k = 0; k < 3; k++) {
    long double aside = x * camera->right[k] + y * camera->up[k];
    eye[k] = camera->position[k] + (camera->perspective ? 0 : aside);
    direction[k] = camera->forward[k] + (camera->perspective ? aside : 0);
  }
  normalise(direction);
}

/* Index axes in mm, and their inverse by cross products (rows: from mm to index displacements). */
static void axes(const tc_volume_desc *desc, long double axis[3][3], long double inverse[3][3]) {
  for (int k = 0; k < 3; k++)
    for (int r = 0; r < 3; r++) axis[k][r] = (long double)desc->direction[3 * r + k] * desc->spacing[k];
  for (int k = 0; k < 3; k++) {
    cross(axis[(k + 1) % 3], axis[(k + 2) % 3], inverse[k]);
    long double det = dot(inverse[k], axis[k]);
    for (int r = 0; r < 3; r++) inverse[k][r] /= det;
  }
}

static bool clip_to_box(tc_ref_ray *ray, const tc_volume_desc *desc) {
  for (int k = 0; k < 3; k++) {
    double lo = desc->dims[k] == 1 ? -0.5 : 0, hi = desc->dims[k] == 1 ? 0.5 : desc->dims[k] - 1;
    double o = ray->origin[k], d = ray->direction[k];
    if (d == 0) {
      if (o < lo || o > hi) return false;
      continue;
    }
    double a = (lo - o) / d, b = (hi - o) / d;
    ray->enter = fmax(ray->enter, fmin(a, b));
    ray->leave = fmin(ray->leave, fmax(a, b));
  }
  return ray->enter < ray->leave;
}

bool tc_ref_ray_enter(const tc_ref_ray *open, const tc_volume_desc *desc, tc_ref_ray *box) {
  long double axis[3][3], inverse[3][3], from[3], to[3];
  axes(desc, axis, inverse);
  *box = *open;
  for (int k = 0; k < 3; k++) from[k] = (long double)open->lps[k] - desc->origin[k], to[k] = open->lps_direction[k];
  for (int k = 0; k < 3; k++) {
    box->origin[k] = (double)dot(inverse[k], from);
    box->direction[k] = (double)dot(inverse[k], to);
  }
  return open->enter < open->leave && clip_to_box(box, desc);
}

void tc_ref_ray_cast(const tc_ref_camera *camera, const tc_ref_clip *clip, const tc_volume_desc *desc, double px,
                     double py, tc_ref_cast *cast) {
  tc_ref_ray *ray = &cast->box;
  long double eye[3], direction[3], axis[3][3], inverse[3][3], to_center[3], point[3];
  eye_ray(camera, px, py, eye, direction);
  axes(desc, axis, inverse);
  for (int r = 0; r < 3; r++) {
    to_center[r] = desc->origin[r] - eye[r];
    for (int k = 0; k < 3; k++) to_center[r] += axis[k][r] * (desc->dims[k] - 1) / 2;
  }
  long double nearest = dot(to_center, direction);
  for (int r = 0; r < 3; r++) {
    point[r] = eye[r] + nearest * direction[r] - desc->origin[r];
    ray->lps[r] = (double)(point[r] + desc->origin[r]);
    ray->lps_direction[r] = (double)direction[r];
  }
  for (int k = 0; k < 3; k++) {
    ray->origin[k] = (double)dot(inverse[k], point);
    ray->direction[k] = (double)dot(inverse[k], direction);
  }
  ray->eye = (double)-nearest;
  ray->enter = ray->eye;
  ray->leave = INFINITY;
  const bool visible = tc_ref_clip_ray(clip, ray);
  cast->open = *ray;
  if (!visible) cast->open.enter = cast->open.leave = 0;
  cast->in_box = visible && clip_to_box(ray, desc);
}
