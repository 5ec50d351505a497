/* Constraints between the members of a complete scene. */
#include <string.h>

#include "protocol/internal.h"
#include "renderer/scene/scene_check.h"

static bool patch_has(const cJSON *patch, const char *group, const char *name) {
  return cJSON_GetObjectItemCaseSensitive(cJSON_GetObjectItemCaseSensitive(patch, group), name) != NULL;
}

/* If two members conflict, blames the one in the patch. */
static bool check_camera(const tc_camera *camera, const cJSON *patch, GError **error) {
  const char *pointer, *fault = tc_camera_fault(camera, &pointer);
  if (!fault) return true;
  const bool moved = patch_has(patch, "camera", "position") && !patch_has(patch, "camera", "target");
  if (moved && strcmp(pointer, "/camera/target") == 0) pointer = "/camera/position";
  return tcp_fail_at(error, TC_ERROR_INVALID, pointer, "%s", fault);
}

static bool check_image(const tc_scene *scene, const cJSON *patch, GError **error) {
  long area = (long)scene->image.width * scene->image.height;
  if (!tc_image_fits(scene->image.width, scene->image.height))
    return tcp_fail_at(error, TC_ERROR_LIMIT, "/image", "%d x %d is %ld pixels; at most %d are allowed",
                       scene->image.width, scene->image.height, area, TC_MAX_IMAGE_AREA);
  if (!scene->image.transparent || scene->image.format != TC_FORMAT_JPEG) return true;
  bool format_set = patch_has(patch, "image", "format") && !patch_has(patch, "image", "background");
  return tcp_fail_at(error, TC_ERROR_INVALID, format_set ? "/image/format" : "/image/background",
                     "JPEG has no transparency; set image.format \"png\" or a background colour [r,g,b]");
}

static bool check_mpr(const tc_scene *scene, GError **error) {
  const char *pointer, *fault = tc_slice_fault(scene, &pointer);
  return !fault || tcp_fail_at(error, TC_ERROR_INVALID, pointer, "%s", fault);
}

static bool check_splat(const tc_scene *scene, GError **error) {
  if (scene->splat.threshold[0] <= scene->splat.threshold[1]) return true;
  return tcp_fail_at(error, TC_ERROR_INVALID, "/splat/threshold", "the low value exceeds the high one; swap them");
}

bool tcp_scene_check(const tc_scene *scene, const cJSON *patch, GError **error) {
  return check_image(scene, patch, error) && check_camera(&scene->camera, patch, error) && check_mpr(scene, error) &&
         check_splat(scene, error);
}
