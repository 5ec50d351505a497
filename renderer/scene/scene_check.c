#include "renderer/scene/scene_check.h"

#include <math.h>

#include "renderer/base/vector.h"

/* Sine of the least angle between two directions that still span a plane in single precision. */
#define PARALLEL_SINE 1e-6

static const char *fault(const char **pointer, const char *at, const char *message) {
  *pointer = at;
  return message;
}

/* hypot() keeps very long and very short vectors from overflowing and vanishing. */
static double length(const double v[3]) { return hypot(hypot(v[0], v[1]), v[2]); }

static bool are_parallel(const double a[3], const double b[3]) {
  const double la = length(a), lb = length(b);
  double cross[3];
  for (int k = 0; k < 3; k++) {
    int i = (k + 1) % 3, j = (k + 2) % 3;
    cross[k] = a[i] / la * (b[j] / lb) - a[j] / la * (b[i] / lb);
  }
  return !(length(cross) >= PARALLEL_SINE);
}

const char *tc_camera_fault(const tc_camera *c, const char **pointer) {
  double view[3];
  for (int k = 0; k < 3; k++) view[k] = c->target[k] - c->position[k];
  if (!finite3(c->position)) return fault(pointer, "/camera/position", "three finite numbers expected");
  if (!finite3(c->target)) return fault(pointer, "/camera/target", "three finite numbers expected");
  if (!finite3(c->up)) return fault(pointer, "/camera/up", "three finite numbers expected");
  if (!(length(view) > 0))
    return fault(pointer, "/camera/target", "position and target are the same point; move one of them");
  if (!(length(c->up) > 0)) return fault(pointer, "/camera/up", "[0,0,0] is no direction; give one, as [0,0,1]");
  if (are_parallel(view, c->up))
    return fault(pointer, "/camera/up", "parallel to the view direction (target - position); give another direction");
  if (c->projection == TC_PERSPECTIVE && !(c->fov_y_deg > 0 && c->fov_y_deg < 180))
    return fault(pointer, "/camera/fovY", "degrees above 0 and below 180 expected");
  if (c->projection == TC_ORTHOGRAPHIC && !(c->height_mm > 0 && isfinite(c->height_mm)))
    return fault(pointer, "/camera/height", "mm above 0 expected");
  return NULL;
}

const char *tc_slice_fault(const tc_scene *scene, const char **pointer) {
  const double *normal = scene->mpr.normal, *up = scene->mpr.up;
  if (scene->mpr.orientation != TC_OBLIQUE) return NULL;
  if (!(length(normal) > 0) || !finite3(normal))
    return fault(pointer, "/mpr/normal", "[0,0,0] is no direction; give the plane's normal");
  if (!(length(up) > 0) || !finite3(up) || are_parallel(normal, up))
    return fault(pointer, "/mpr/up", "zero or parallel to mpr.normal; give another direction");
  return NULL;
}

bool tc_image_fits(int width, int height) {
  return width <= TC_MAX_IMAGE_SIDE && height <= TC_MAX_IMAGE_SIDE && (int64_t)width * height <= TC_MAX_IMAGE_AREA;
}
