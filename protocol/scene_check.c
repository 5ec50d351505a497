/* What must hold between the members of a complete scene. */
#include <math.h>
#include <string.h>

#include "protocol/internal.h"

/* Sine of the least angle between two directions that still span a plane in float arithmetic. */
#define PARALLEL_SINE 1e-6

static double length(const double v[3]) { return hypot(hypot(v[0], v[1]), v[2]); }

static bool unit(const double v[3], double out[3]) {
  double l = length(v);
  for (int i = 0; i < 3; i++)
    out[i] = l > 0 ? v[i] / l : 0;
  return l > 0;
}

static bool parallel(const double a[3], const double b[3]) {
  double x[3], y[3];
  if (!unit(a, x) || !unit(b, y)) return true;
  double cross[3] = {x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]};
  return length(cross) < PARALLEL_SINE;
}

static bool patch_has(const cJSON *patch, const char *group, const char *name) {
  return cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(patch, group), name) != NULL;
}

static bool check_camera(const tc_camera *camera, const cJSON *patch, GError **error) {
  double view[3];
  for (int i = 0; i < 3; i++)
    view[i] = camera->target[i] - camera->position[i];
  bool moved = patch_has(patch, "camera", "position") && !patch_has(patch, "camera", "target");
  if (length(view) == 0)
    return tcp_fail_at(error, TC_ERROR_INVALID, moved ? "/camera/position" : "/camera/target",
                       "position and target are the same point; move one of them");
  if (length(camera->up) == 0)
    return tcp_fail_at(error, TC_ERROR_INVALID, "/camera/up", "[0,0,0] is no direction; give one, as [0,0,1]");
  if (parallel(view, camera->up))
    return tcp_fail_at(error, TC_ERROR_INVALID, "/camera/up",
                       "parallel to the view direction (target - position); give another direction");
  return true;
}

static bool check_image(const tc_scene *scene, const cJSON *patch, GError **error) {
  long area = (long)scene->image.width * scene->image.height;
  if (area > TC_MAX_IMAGE_AREA)
    return tcp_fail_at(error, TC_ERROR_LIMIT, "/image", "%d x %d is %ld pixels; at most %d are wanted",
                       scene->image.width, scene->image.height, area, TC_MAX_IMAGE_AREA);
  if (!scene->image.transparent || scene->image.format != TC_FORMAT_JPEG) return true;
  bool format_set = patch_has(patch, "image", "format") && !patch_has(patch, "image", "background");
  return tcp_fail_at(error, TC_ERROR_INVALID, format_set ? "/image/format" : "/image/background",
                     "JPEG has no transparency; set image.format \"png\" or a background colour [r,g,b]");
}

static bool check_mpr(const tc_scene *scene, GError **error) {
  if (scene->mpr.orientation != TC_OBLIQUE) return true;
  if (length(scene->mpr.normal) == 0)
    return tcp_fail_at(error, TC_ERROR_INVALID, "/mpr/normal", "[0,0,0] is no direction; give the plane's normal");
  if (parallel(scene->mpr.normal, scene->mpr.up))
    return tcp_fail_at(error, TC_ERROR_INVALID, "/mpr/up", "zero or parallel to mpr.normal; give another direction");
  return true;
}

static bool check_splat(const tc_scene *scene, GError **error) {
  if (scene->splat.threshold[0] <= scene->splat.threshold[1]) return true;
  return tcp_fail_at(error, TC_ERROR_INVALID, "/splat/threshold", "the low value exceeds the high one; swap them");
}

bool tcp_scene_check(const tc_scene *scene, const cJSON *patch, GError **error) {
  return check_image(scene, patch, error) && check_camera(&scene->camera, patch, error) && check_mpr(scene, error) &&
         check_splat(scene, error);
}
