#include "renderer/scene.h"

#include <glib.h>
#include <string.h>

const char *const tc_mode_names[] = {"dvr", "mip", "minip", "average", "isosurface", "mesh", "splat", "mpr", NULL};
const char *const tc_classification_names[] = {"preintegrated", "preintegrated2", "approximate",
                                               "post",          "linearized",     NULL};
const char *const tc_order_names[] = {"front-to-back", "back-to-front", NULL};
const char *const tc_filter_names[] = {"linear", "cubic", "nearest", NULL};
const char *const tc_shading_names[] = {"none", "lambert", "blinn-phong", "gooch", NULL};
const char *const tc_gradient_names[] = {"cell", "central", "cubic", NULL};
const char *const tc_slab_projection_names[] = {"mip", "minip", "average", NULL};

#define SAME_COUNT(names, count) G_STATIC_ASSERT(G_N_ELEMENTS(names) == (count) + 1)
SAME_COUNT(tc_mode_names, TC_MODE_COUNT);
SAME_COUNT(tc_classification_names, TC_CLASSIFICATION_COUNT);
SAME_COUNT(tc_order_names, TC_ORDER_COUNT);
SAME_COUNT(tc_filter_names, TC_FILTER_COUNT);
SAME_COUNT(tc_shading_names, TC_SHADING_COUNT);
SAME_COUNT(tc_gradient_names, TC_GRADIENT_COUNT);
SAME_COUNT(tc_slab_projection_names, TC_SLAB_PROJECTION_COUNT);

static void set3(double to[3], double x, double y, double z) {
  to[0] = x;
  to[1] = y;
  to[2] = z;
}

static void init_camera(tc_camera *camera) {
  camera->projection = TC_PERSPECTIVE;
  set3(camera->position, 0, -600, 0); /* in front of the patient: y grows towards the back */
  set3(camera->target, 0, 0, 0);
  set3(camera->up, 0, 0, 1);
  camera->fov_y_deg = 30;
  camera->height_mm = 300;
}

static void init_image(tc_scene *scene) {
  scene->image.width = scene->image.height = 512;
  scene->image.format = TC_FORMAT_JPEG;
  scene->image.quality = 85;
  scene->image.subsampling = TC_SUBSAMPLING_AUTO;
}

static void init_surfaces(tc_scene *scene) {
  scene->shading.model = TC_SHADING_NONE;
  scene->shading.gradient = TC_GRADIENT_CELL;
  scene->shading.ambient = 0.2;
  scene->shading.diffuse = 0.7;
  scene->shading.specular = 0.2;
  scene->shading.shininess = 20;
  scene->shading.light_at_camera = true;
  set3(scene->shading.light, 0, -1, 0);
  scene->isosurface.value = 300;
  set3(scene->isosurface.color, 0.92, 0.87, 0.77);
  scene->splat.threshold[0] = 300;
  scene->splat.threshold[1] = 4000;
  scene->splat.kernel_radius = 1;
  scene->splat.culling = true;
}

static void init_mpr(tc_scene *scene) {
  scene->mpr.orientation = TC_AXIAL;
  set3(scene->mpr.normal, 0, 0, -1); /* an axial picture is seen from the feet */
  set3(scene->mpr.up, 0, -1, 0); /* the front of the patient is on top of an axial picture */
  scene->mpr.projection = TC_SLAB_AVERAGE;
  scene->mpr.zoom = 1;
}

void tc_scene_init(tc_scene *scene) {
  memset(scene, 0, sizeof *scene);
  scene->mode = TC_MODE_DVR;
  init_image(scene);
  init_camera(&scene->camera);
  tc_transfer_function_set_preset(&scene->transfer_function, "grey-ramp", 0, 1);
  scene->window.center = 40;
  scene->window.width = 400;
  scene->classification = TC_PREINTEGRATED;
  scene->order = TC_FRONT_TO_BACK;
  scene->filter = TC_FILTER_LINEAR;
  scene->sampling.step = 1;
  scene->sampling.rays_per_pixel = 1;
  scene->sampling.termination = 0.001;
  scene->skipping.mode = TC_SKIPPING_AUTO;
  init_surfaces(scene);
  init_mpr(scene);
  scene->labels.opacity = 0.5;
}

/* g_memdup2 of nothing is NULL, which is what an empty list is. */
static void *copy_array(const void *from, size_t count, size_t size) {
  return count ? g_memdup2(from, count * size) : NULL;
}

void tc_scene_copy(tc_scene *to, const tc_scene *from) {
  *to = *from;
  to->transfer_function.points =
      copy_array(from->transfer_function.points, from->transfer_function.count, sizeof(tc_knot));
  to->labels.colors = copy_array(from->labels.colors, from->labels.n_colors, sizeof(tc_label_color));
  to->labels.visible = copy_array(from->labels.visible, from->labels.n_visible, sizeof(uint32_t));
  /* "none visible" is an empty list that is not NULL, NULL being "all" */
  if (from->labels.visible && !to->labels.visible) to->labels.visible = g_new0(uint32_t, 1);
}

void tc_scene_clear(tc_scene *scene) {
  g_free(scene->transfer_function.points);
  g_free(scene->labels.colors);
  g_free(scene->labels.visible);
  memset(scene, 0, sizeof *scene);
}

bool tc_transfer_function_set_preset(tc_transfer_function *tf, const char *name, double lo, double hi) {
  size_t count;
  const tc_preset *preset = tc_presets(&count);
  while (count && strcmp(preset->name, name) != 0)
    preset++, count--;
  if (!count) return false;
  tc_knot *points = g_memdup2(preset->points, preset->count * sizeof(tc_knot));
  if (preset->relative)
    for (size_t i = 0; i < preset->count; i++) /* weights, not lo + v*(hi-lo): no overflow, ends exact */
      points[i].value = lo * (1 - points[i].value) + hi * points[i].value;
  g_free(tf->points);
  tf->points = points;
  tf->count = preset->count;
  tf->kind = preset->kind;
  tf->unit_distance_mm = preset->unit_distance_mm;
  g_strlcpy(tf->preset, preset->name, sizeof tf->preset);
  return true;
}
