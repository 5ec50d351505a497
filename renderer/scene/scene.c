#include "renderer/scene/scene.h"

#include <glib.h>
#include <math.h>
#include <stdatomic.h>
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

static void init_shading(tc_scene *scene) {
  scene->shading.model = TC_SHADING_NONE;
  scene->shading.gradient = TC_GRADIENT_CENTRAL;
  scene->shading.ambient = 0.2;
  scene->shading.diffuse = 0.7;
  scene->shading.specular = 0.2;
  scene->shading.shininess = 20;
  scene->shading.light_at_camera = true;
  set3(scene->shading.light, 0, -1, 0);
}

static void init_surfaces(tc_scene *scene) {
  scene->isosurface.value = 300;
  set3(scene->isosurface.color, 0.92, 0.87, 0.77);
  scene->splat.threshold[0] = 300;
  scene->splat.threshold[1] = 4000;
  scene->splat.kernel_radius = 1;
  scene->splat.opaque = true;
  scene->splat.culling = true;
}

static void init_mpr(tc_scene *scene) {
  scene->mpr.orientation = TC_AXIAL;
  set3(scene->mpr.normal, 0, 0, -1); /* an axial picture is seen from the feet */
  set3(scene->mpr.up, 0, -1, 0);     /* the front of the patient is on top of an axial picture */
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
  init_shading(scene);
  init_surfaces(scene);
  init_mpr(scene);
  scene->labels.opacity = 0.5;
}

/* --- lists by reference ----------------------------------------------------------------------------- */

struct tc_shared {
  atomic_size_t references;
  void *memory; /* freed by g_free() */
  size_t size;
  atomic_uint_fast64_t digest; /* 0 = not known yet */
};

static tc_shared *shared_new(void *memory, size_t size) {
  tc_shared *shared = g_new(tc_shared, 1);
  atomic_init(&shared->references, 1);
  atomic_init(&shared->digest, 0);
  shared->memory = memory;
  shared->size = size;
  return shared;
}

static void shared_unref(tc_shared *shared) {
  if (atomic_fetch_sub_explicit(&shared->references, 1, memory_order_acq_rel) > 1) return;
  g_free(shared->memory);
  g_free(shared);
}

/* Hashes eight bytes at a time (lists consist of whole words). Seeded at random, so that a client cannot construct
 * collisions. */
uint64_t tc_shared_digest(tc_shared *shared) {
  static atomic_uint_fast64_t seed;
  uint64_t start = atomic_load(&seed), none = 0, word;
  if (!shared) return 0;
  uint64_t h = atomic_load(&shared->digest);
  if (h) return h;
  if (!start) {
    const uint64_t random = ((uint64_t)g_random_int() << 32 | g_random_int()) | 1;
    start = atomic_compare_exchange_strong(&seed, &none, random) ? random : none;
  }
  h = start ^ shared->size;
  const char *bytes = shared->memory;
  for (size_t at = 0; at < shared->size; at += sizeof word) {
    word = 0;
    memcpy(&word, bytes + at, MIN(sizeof word, shared->size - at));
    h = (h ^ word) * 0x9e3779b97f4a7c15u;
    h ^= h >> 29;
  }
  h += h == 0;
  atomic_store(&shared->digest, h);
  return h;
}

static void list_drop(void *items, tc_shared **shared) {
  if (*shared)
    shared_unref(*shared);
  else
    g_free(items);
  *shared = NULL;
}

static void list_share(void *items, size_t size, tc_shared **shared) {
  if (items && !*shared) *shared = shared_new(items, size);
}

/* Completes a bitwise copy of a list: adds a reference if the list is shared, else returns a copy. An empty list that
 * is not NULL stays so: for visible labels it means "none", and NULL means "all". */
static void *list_hold(void *items, size_t size, tc_shared **shared) {
  if (*shared) {
    atomic_fetch_add_explicit(&(*shared)->references, 1, memory_order_relaxed);
    return items;
  }
  if (!items) return NULL;
  void *copy = size ? g_memdup2(items, size) : g_malloc0(1);
  list_share(copy, size, shared);
  return copy;
}

static size_t points_size(const tc_scene *s) { return s->transfer_function.count * sizeof(tc_knot); }
static size_t colors_size(const tc_scene *s) { return s->labels.n_colors * sizeof(tc_label_color); }
static size_t visible_size(const tc_scene *s) { return s->labels.n_visible * sizeof(uint32_t); }
static size_t surfaces_size(const tc_scene *s) { return s->mesh.n_surfaces * sizeof(tc_mesh_surface); }

void tc_scene_copy(tc_scene *to, const tc_scene *from) {
  *to = *from;
  tc_transfer_function *tf = &to->transfer_function;
  tf->points = list_hold(tf->points, points_size(to), &tf->shared);
  to->labels.colors = list_hold(to->labels.colors, colors_size(to), &to->labels.shared_colors);
  to->labels.visible = list_hold(to->labels.visible, visible_size(to), &to->labels.shared_visible);
  to->mesh.surfaces = list_hold(to->mesh.surfaces, surfaces_size(to), &to->mesh.shared_surfaces);
}

void tc_scene_share(tc_scene *scene) {
  list_share(scene->transfer_function.points, points_size(scene), &scene->transfer_function.shared);
  list_share(scene->labels.colors, colors_size(scene), &scene->labels.shared_colors);
  list_share(scene->labels.visible, visible_size(scene), &scene->labels.shared_visible);
  list_share(scene->mesh.surfaces, surfaces_size(scene), &scene->mesh.shared_surfaces);
}

void tc_scene_clear(tc_scene *scene) {
  list_drop(scene->transfer_function.points, &scene->transfer_function.shared);
  list_drop(scene->labels.colors, &scene->labels.shared_colors);
  list_drop(scene->labels.visible, &scene->labels.shared_visible);
  list_drop(scene->mesh.surfaces, &scene->mesh.shared_surfaces);
  memset(scene, 0, sizeof *scene);
}

void tc_scene_set_points(tc_scene *scene, tc_knot *points, size_t count) {
  list_drop(scene->transfer_function.points, &scene->transfer_function.shared);
  scene->transfer_function.points = points;
  scene->transfer_function.count = count;
}

void tc_scene_set_colors(tc_scene *scene, tc_label_color *colors, size_t count) {
  list_drop(scene->labels.colors, &scene->labels.shared_colors);
  scene->labels.colors = colors;
  scene->labels.n_colors = count;
}

void tc_scene_set_visible(tc_scene *scene, uint32_t *visible, size_t count) {
  list_drop(scene->labels.visible, &scene->labels.shared_visible);
  scene->labels.visible = visible;
  scene->labels.n_visible = count;
}

void tc_scene_set_surfaces(tc_scene *scene, tc_mesh_surface *surfaces, size_t count) {
  list_drop(scene->mesh.surfaces, &scene->mesh.shared_surfaces);
  scene->mesh.surfaces = surfaces;
  scene->mesh.n_surfaces = count;
}

void tc_scene_take_points(tc_scene *scene, const tc_scene *from) {
  tc_shared *shared = from->transfer_function.shared;
  tc_scene_set_points(scene, list_hold(from->transfer_function.points, points_size(from), &shared),
                      from->transfer_function.count);
  scene->transfer_function.shared = shared;
}

void tc_scene_take_colors(tc_scene *scene, const tc_scene *from) {
  tc_shared *shared = from->labels.shared_colors;
  tc_scene_set_colors(scene, list_hold(from->labels.colors, colors_size(from), &shared), from->labels.n_colors);
  scene->labels.shared_colors = shared;
}

void tc_scene_take_visible(tc_scene *scene, const tc_scene *from) {
  tc_shared *shared = from->labels.shared_visible;
  tc_scene_set_visible(scene, list_hold(from->labels.visible, visible_size(from), &shared), from->labels.n_visible);
  scene->labels.shared_visible = shared;
}

void tc_scene_take_surfaces(tc_scene *scene, const tc_scene *from) {
  tc_shared *shared = from->mesh.shared_surfaces;
  tc_scene_set_surfaces(scene, list_hold(from->mesh.surfaces, surfaces_size(from), &shared), from->mesh.n_surfaces);
  scene->mesh.shared_surfaces = shared;
}

const tc_preset *tc_preset_named(const char *name) {
  size_t count;
  const tc_preset *preset = tc_presets(&count);
  for (; count; preset++, count--)
    if (strcmp(preset->name, name) == 0) return preset;
  return NULL;
}

static double weighted(double from, double to, double at) {
  return from * (1 - at) + to * at; /* not from + at*(to-from): no overflow, ends exact */
}

static double stretched(const tc_stretch *s, double at) {
  return at < TC_STRETCH_MIDDLE ? weighted(s->low, s->middle, at / TC_STRETCH_MIDDLE)
                                : weighted(s->middle, s->high, (at - TC_STRETCH_MIDDLE) / (1 - TC_STRETCH_MIDDLE));
}

static bool set_preset(tc_transfer_function *tf, const tc_preset *preset, tc_knot *points, double unit) {
  list_drop(tf->points, &tf->shared);
  tf->points = points;
  tf->count = preset->count;
  tf->kind = preset->kind;
  tf->unit_distance_mm = preset->unit_distance_mm * unit;
  g_strlcpy(tf->preset, preset->name, sizeof tf->preset);
  return true;
}

bool tc_transfer_function_set_preset(tc_transfer_function *tf, const char *name, double lo, double hi) {
  const tc_preset *preset = tc_preset_named(name);
  if (!preset) return false;
  tc_knot *points = g_memdup2(preset->points, preset->count * sizeof(tc_knot));
  for (size_t i = 0; preset->relative && i < preset->count; i++) points[i].value = weighted(lo, hi, points[i].value);
  return set_preset(tf, preset, points, 1);
}

bool tc_transfer_function_fit_preset(tc_transfer_function *tf, const char *name, const tc_stretch *stretch) {
  const tc_preset *preset = tc_preset_named(name);
  if (!preset) return false;
  tc_knot *points = g_memdup2(preset->points, preset->count * sizeof(tc_knot));
  for (size_t i = 0; preset->relative && i < preset->count; i++) {
    points[i].value = stretched(stretch, points[i].value);
    if (i > 0) points[i].value = fmax(points[i].value, points[i - 1].value); /* rounding may swap equal knots */
  }
  return set_preset(tf, preset, points, stretch->unit);
}

void tc_scene_light(tc_scene *scene, bool lit) {
  init_shading(scene);
  if (!lit) return;
  scene->shading.model = TC_SHADING_BLINN_PHONG;
  scene->shading.ambient = 0.1;
  scene->shading.diffuse = 0.9;
  scene->shading.specular = 0.2;
  scene->shading.shininess = 10;
}
