#include "server/session/scene.h"

#include <inttypes.h>

#include "server/catalogue/catalogue.h"
#include "server/config/config.h"
#include "server/session/samples.h"

bool tcs_scene_check(tcs_server *server, const tc_volume *volume, const tc_scene *scene, const tc_scene *valid,
                     tc_volume **labels, GError **error) {
  const tcs_limits *limits = &server->config->limits;
  *labels = NULL;
  if (scene->image.width > limits->image_side || scene->image.height > limits->image_side) {
    const bool wide = scene->image.width > limits->image_side;
    tc_set_error(error, TC_ERROR_LIMIT, wide ? "/image/width" : "/image/height",
                 "image: at most %" PRId64 " pixels a side", limits->image_side);
    return false;
  }
  if ((int64_t)scene->image.width * scene->image.height > limits->image_area) {
    tc_set_error(error, TC_ERROR_LIMIT, "/image/width", "image: at most %" PRId64 " pixels in all", limits->image_area);
    return false;
  }
  if (scene->sampling.rays_per_pixel > limits->rays_per_pixel) {
    tc_set_error(error, TC_ERROR_LIMIT, "/sampling/raysPerPixel", "raysPerPixel: at most %" PRId64,
                 limits->rays_per_pixel);
    return false;
  }
  if ((int64_t)scene->transfer_function.count > limits->knots) {
    tc_set_error(error, TC_ERROR_LIMIT, "/transferFunction/points", "points: at most %" PRId64, limits->knots);
    return false;
  }
  if (scene->labels.volume[0]) {
    GError *why = NULL;
    tcs_entry *entry = tcs_catalogue_resident(server->catalogue, scene->labels.volume, NULL, &why);
    if (!entry) {
      tc_set_error(error, TC_ERROR_INVALID, "/labels/volume", "labels/volume: %s", why->message);
      g_error_free(why);
      return false;
    }
    *labels = entry->volume;
  }
  const tcs_samples_limits most = {(double)limits->render_samples, (double)limits->ray_samples};
  return tc_plan_check(volume, scene, scene->image.width, scene->image.height, valid, error) &&
         tc_labels_check(volume, *labels, scene, error) && tcs_samples_check(volume, scene, &most, error);
}

bool tcs_scene_patch(tc_scene *scene, const tc_scene *defaults, const tc_volume *volume, const cJSON *patch,
                     const tcp_lists *lists, GError **error) {
  const tc_volume_stats *stats = tc_volume_statistics(volume);
  const tcp_scene_context context = {stats->min, stats->max, lists};
  return tcp_scene_patch(scene, patch, defaults, &context, error);
}

bool tcs_scene_make(tcs_server *server, const tcs_entry *entry, const cJSON *patch, const tcp_lists *lists,
                    tc_scene *scene, GError **error) {
  tc_volume *labels;
  tc_scene_copy(scene, &entry->defaults);
  tcp_scene_light(scene, patch);
  const bool ok = (!patch || tcs_scene_patch(scene, &entry->defaults, entry->volume, patch, lists, error)) &&
                  tcs_scene_check(server, entry->volume, scene, NULL, &labels, error);
  if (!ok) tc_scene_clear(scene);
  return ok;
}
