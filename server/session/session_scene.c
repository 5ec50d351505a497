#include "server/session/session_scene.h"

#include <inttypes.h>
#include <string.h>

#include "server/catalogue/catalogue.h"
#include "server/config/config.h"
#include "server/session/labels_check.h"
#include "server/schedule/job.h"
#include "server/session/samples.h"

/* Whether two scenes certainly take the same number of samples: equal bit for bit, except for members that do not
 * matter. */
static bool same_samples(const tc_scene *a, const tc_scene *b) {
  tc_scene x = *a, y = *b; /* borrow */
  memset(&x.transfer_function, 0, sizeof x.transfer_function);
  memset(&y.transfer_function, 0, sizeof y.transfer_function);
  x.window = y.window;
  x.labels.colors = y.labels.colors, x.labels.n_colors = y.labels.n_colors;
  x.labels.visible = y.labels.visible, x.labels.n_visible = y.labels.n_visible;
  x.labels.shared_colors = y.labels.shared_colors, x.labels.shared_visible = y.labels.shared_visible;
  return memcmp(&x, &y, sizeof x) == 0;
}

/* Whether the patch sets a new label volume without labels.force. */
static bool doubts_labels(const tc_scene *scene, const tc_scene *valid, const cJSON *patch) {
  const cJSON *labels = cJSON_GetObjectItemCaseSensitive(patch, "labels");
  const bool known = valid && strcmp(valid->labels.volume, scene->labels.volume) == 0;
  return cJSON_HasObjectItem(labels, "volume") && !known &&
         !cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(labels, "force"));
}

static bool check_meshes(tcs_server *server, const tc_scene *scene, GError **error) {
  for (size_t i = 0; i < scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *s = &scene->mesh.surfaces[i];
    char pointer[40];
    g_snprintf(pointer, sizeof pointer, "/mesh/surfaces/%zu/mesh", i);
    GError *why = NULL;
    if (s->source != TC_SURFACE_OF_MESH || tcs_catalogue_resident(server->catalogue, TCS_KIND_MESH, s->mesh, NULL, &why))
      continue;
    tc_set_error(error, TC_ERROR_INVALID, pointer, "%s: %s", pointer + 1, why->message);
    g_error_free(why);
    return false;
  }
  return true;
}

tc_mesh **tcs_scene_meshes(tcs_server *server, const tc_scene *scene) {
  tc_mesh **meshes = NULL;
  for (size_t i = 0; i < scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *s = &scene->mesh.surfaces[i];
    const tcs_entry *entry =
        s->source == TC_SURFACE_OF_MESH ? tcs_catalogue_find(server->catalogue, TCS_KIND_MESH, s->mesh) : NULL;
    if (!entry || !entry->mesh) continue;
    if (!meshes) meshes = g_new0(tc_mesh *, scene->mesh.n_surfaces);
    meshes[i] = tc_mesh_ref(entry->mesh);
  }
  return meshes;
}

bool tcs_image_check(const tcs_limits *limits, const char *image, int64_t width, int64_t height, GError **error) {
  const bool wide = width > limits->image_side, high = height > limits->image_side;
  char pointer[32];
  if (!wide && !high && width * height <= limits->image_area) return true;
  g_snprintf(pointer, sizeof pointer, "%s/%s", image, high && !wide ? "height" : "width");
  tc_set_error(error, TC_ERROR_LIMIT, pointer, "image: at most %" PRId64 " pixels a side and %" PRId64 " in all",
               limits->image_side, limits->image_area);
  return false;
}

static bool check_count(int64_t count, int64_t most, const char *pointer, GError **error) {
  if (count <= most) return true;
  tc_set_error(error, TC_ERROR_LIMIT, pointer, "%s: at most %" PRId64, strrchr(pointer, '/') + 1, most);
  return false;
}

static bool check_samples(tcs_server *server, const tc_volume *volume, const tc_scene *scene, GError **error) {
  const tcs_limits *limits = &server->config->limits;
  const tcs_samples_limits most = {(double)limits->render_samples, (double)limits->ray_samples};
  tc_mesh **meshes = tcs_scene_meshes(server, scene);
  const bool ok = tcs_samples_check(volume, scene, meshes, &most, error);
  tcs_meshes_free(meshes, scene->mesh.n_surfaces);
  return ok;
}

bool tcs_scene_check(tcs_server *server, const tc_volume *volume, const tc_scene *scene, tcs_scene_change change,
                     tc_volume **labels, GError **error) {
  const tc_scene *valid = change.valid;
  const tcs_limits *limits = &server->config->limits;
  *labels = NULL;
  if (!tcs_image_check(limits, "/image", scene->image.width, scene->image.height, error) ||
      !check_count(scene->sampling.rays_per_pixel, limits->rays_per_pixel, "/sampling/raysPerPixel", error) ||
      !check_count((int64_t)scene->transfer_function.count, limits->knots, "/transferFunction/points", error))
    return false;
  if (scene->labels.volume[0]) {
    GError *why = NULL;
    tcs_entry *entry = tcs_catalogue_resident(server->catalogue, TCS_KIND_VOLUME, scene->labels.volume, NULL, &why);
    if (!entry) {
      tc_set_error(error, TC_ERROR_INVALID, "/labels/volume", "labels/volume: %s", why->message);
      g_error_free(why);
      return false;
    }
    *labels = entry->volume;
  }
  return check_meshes(server, scene, error) && tc_plan_check(volume, scene, scene->image.width, scene->image.height, valid, error) &&
         tc_labels_check(volume, *labels, scene, error) &&
         (!*labels || !doubts_labels(scene, valid, change.patch) || tcs_labels_check(volume, *labels, error)) &&
         ((valid && same_samples(scene, valid)) || check_samples(server, volume, scene, error));
}

bool tcs_scene_patch(tc_scene *scene, const tc_scene *defaults, const tcs_entry *entry, const cJSON *patch,
                     const tcp_lists *lists, GError **error) {
  const tcp_scene_context context = {.lists = lists, .stretch = &entry->fit.stretch};
  return tcp_scene_patch(scene, patch, defaults, &context, error);
}

void tcs_scene_fit_window(tc_scene *scene, const tc_fit *fit, const cJSON *document) {
  const char *mode = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(document, "mode"));
  for (int i = 0; mode && i < TC_MODE_COUNT; i++) {
    if (strcmp(mode, tc_mode_names[i]) != 0 || !(fit->windows[i].width > 0)) continue;
    scene->window.center = fit->windows[i].center;
    scene->window.width = fit->windows[i].width;
  }
}

bool tcs_scene_make(tcs_server *server, const tcs_entry *entry, const cJSON *patch, const tcp_lists *lists,
                    tc_scene *scene, GError **error) {
  tc_volume *labels;
  tc_scene_copy(scene, &entry->defaults);
  tcp_scene_light(scene, patch);
  tcs_scene_fit_window(scene, &entry->fit, patch);
  const bool ok = (!patch || tcs_scene_patch(scene, &entry->defaults, entry, patch, lists, error)) &&
                  tcs_scene_check(server, entry->volume, scene, (tcs_scene_change){NULL, patch}, &labels, error);
  if (!ok) tc_scene_clear(scene);
  return ok;
}
