/* The scene of a sub-command: defaults, then a document, then single members, then the image size. */
#include <math.h>

#include "protocol/protocol.h"
#include "server/cli/cli.h"
#include "server/session/session_scene.h"

/* A scene with the largest number of knots is some 8 MiB of text. */
#define MAX_SCENE_BYTES (32u << 20)

typedef struct layer {
  const tcs_cli_scene *from;
  const tc_fit *fit;
  tc_scene defaults, *scene;
} layer;

/* Replaces the document's image format by the output file's. */
static void force_format(const char *format, cJSON *patch) {
  cJSON *image = cJSON_GetObjectItemCaseSensitive(patch, "image");
  if (!image && cJSON_IsObject(patch)) image = cJSON_AddObjectToObject(patch, "image");
  if (!cJSON_IsObject(image)) return;
  cJSON_DeleteItemFromObjectCaseSensitive(image, "format");
  cJSON_AddStringToObject(image, "format", format);
}

/* Takes ownership of the patch. */
static bool lay(layer *l, cJSON *patch, const char *where, GError **error) {
  const tcp_scene_context context = {.stretch = &l->fit->stretch};
  if (patch && l->from->format) force_format(l->from->format, patch);
  if (patch) tcp_scene_light(l->scene, patch);
  if (patch) tcs_scene_fit_window(l->scene, l->fit, patch);
  bool good = patch && tcp_scene_patch(l->scene, patch, &l->defaults, &context, error);
  if (!good) g_prefix_error(error, "%s: ", where);
  cJSON_Delete(patch);
  return good;
}

static bool lay_file(layer *l, GError **error) {
  char *text = NULL;
  size_t size;
  if (!l->from->file) return true;
  if (!tcs_cli_read_text(l->from->file, MAX_SCENE_BYTES, &text, &size, error)) return false;
  cJSON *patch = tcp_json_parse(text, size, error);
  g_free(text);
  return lay(l, patch, l->from->file, error);
}

/* Moves the members of a patch into another; the later value of a member replaces the earlier one. Frees the patch. */
static void merge(cJSON *into, cJSON *patch) {
  for (cJSON *member; (member = cJSON_DetachItemFromArray(patch, 0));) {
    cJSON *earlier = cJSON_GetObjectItemCaseSensitive(into, member->string);
    if (cJSON_IsObject(earlier) && cJSON_IsObject(member)) {
      merge(earlier, member);
    } else {
      if (earlier) cJSON_Delete(cJSON_DetachItemViaPointer(into, earlier));
      cJSON_AddItemToObject(into, member->string, member);
    }
  }
  cJSON_Delete(patch);
}

/* As one patch, so that a member may be out of place until a later one is set, as camera.position before camera.up. */
static bool lay_expressions(layer *l, GError **error) {
  cJSON *all = cJSON_CreateObject();
  for (char **set = l->from->set; set && *set; set++) {
    cJSON *patch = tcp_scene_set_expression(*set, error);
    if (!patch) {
      g_prefix_error(error, "--set: ");
      cJSON_Delete(all);
      return false;
    }
    merge(all, patch);
  }
  return lay(l, all, "--set", error);
}

static bool lay_size(layer *l, GError **error) {
  cJSON *patch = cJSON_CreateObject(), *image = cJSON_AddObjectToObject(patch, "image");
  if (l->from->width) cJSON_AddNumberToObject(image, "width", l->from->width);
  if (l->from->height) cJSON_AddNumberToObject(image, "height", l->from->height);
  return lay(l, patch, "--width, --height", error);
}

bool tcs_cli_lay_scene(const tcs_cli_scene *from, const tc_fit *fit, tc_scene *scene, int *exit_code, GError **error) {
  layer l = {.from = from, .fit = fit, .scene = scene};
  tc_scene_copy(&l.defaults, scene);
  *exit_code = TCS_EXIT_FAILED;
  bool good = lay_file(&l, error);
  if (good) {
    good = lay_expressions(&l, error) && lay_size(&l, error);
    if (!good) *exit_code = TCS_EXIT_USAGE;
  }
  tc_scene_clear(&l.defaults);
  return good;
}

void tcs_cli_place_camera(const tc_volume *volume, double azimuth_deg, double elevation_deg, double zoom,
                          tc_camera *c) {
  double lo[3], hi[3], at[3], p[3], radius = 0, a = azimuth_deg * M_PI / 180, e = elevation_deg * M_PI / 180;
  tc_volume_index_box(volume, lo, hi);
  for (int corner = 0; corner < 8; corner++) {
    double d2 = 0;
    for (int k = 0; k < 3; k++) at[k] = corner >> k & 1 ? hi[k] : lo[k];
    tc_volume_index_to_lps(volume, at, p);
    for (int k = 0; k < 3; k++) d2 += (p[k] - c->target[k]) * (p[k] - c->target[k]);
    radius = fmax(radius, sqrt(d2));
  }
  double distance = radius / sin(M_PI / 12);
  const double back[3] = {cos(e) * sin(a), -cos(e) * cos(a), sin(e)};
  for (int k = 0; k < 3; k++) c->position[k] = c->target[k] + distance * back[k];
  c->projection = TC_PERSPECTIVE;
  c->fov_y_deg = 30 / zoom;
}
