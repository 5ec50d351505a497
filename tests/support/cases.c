#include "tests/support/cases.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/protocol.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"

/* ---- drawing ---- */

static double between(uint64_t *state, double lo, double hi) { return lo + (hi - lo) * test_random(state); }
static double decades(uint64_t *state, double lo, double hi) { return pow(10, between(state, lo, hi)); }
static bool chance(uint64_t *state, double share) { return test_random(state) < share; }
static int pick(uint64_t *state, int count) { return (int)(test_random(state) * count); }

static void draw_volume(test_case *c, uint64_t *s) {
  static const double ranges[][2] = {{0, 1},        {-0x1p31, 0x1p31}, {0, 1e-30},
                                     {-1e30, 1e30}, {1, 1.00000012},   {-1000, 3000}};
  static const double least[] = {0, -128, 0, -32768}, most[] = {255, 127, 65535, 32767};
  int shape = pick(s, 10);
  for (int k = 0; k < 3; k++) {
    c->dims[k] = shape == 0 ? 1 : shape == 1 ? 2 : chance(s, 0.15) ? 1 : 1 + pick(s, 12);
    c->spacing[k] = shape == 2       ? (k == pick(s, 3) ? 1000 : 1)
                    : chance(s, 0.7) ? decades(s, -0.3, 0.3)
                                     : decades(s, -1.5, 1.5);
    c->origin[k] = chance(s, 0.3) ? 0 : between(s, -500, 500);
  }
  if (shape == 3) c->dims[pick(s, 3)] = 200 + pick(s, 1849);
  c->sheared = chance(s, 0.3);
  c->pattern = (test_pattern)(chance(s, 0.5) ? TEST_NOISE : pick(s, TEST_PATTERN_COUNT));
  if (c->type == TC_F32) {
    int range = pick(s, G_N_ELEMENTS(ranges));
    c->lo = ranges[range][0], c->hi = ranges[range][1];
  } else {
    double a = between(s, least[c->type], most[c->type]),
           b = chance(s, 0.3) ? a + 1 : between(s, least[c->type], most[c->type]);
    bool whole = chance(s, 0.5);
    c->lo = whole ? least[c->type] : floor(fmin(a, b));
    c->hi = whole ? most[c->type] : floor(fmax(a, b));
  }
  c->slope = chance(s, 0.5) ? 1 : (chance(s, 0.3) ? -1 : 1) * decades(s, -9, 9);
  c->intercept = chance(s, 0.5) ? 0 : -c->slope * between(s, 0, 1000);
}

static void draw_knots(test_case *c, uint64_t *s) {
  tc_transfer_function *tf = &c->scene.transfer_function;
  tf->kind = chance(s, 0.5) ? TC_KNOT_OPACITY : TC_KNOT_EXTINCTION;
  tf->unit_distance_mm = chance(s, 0.7) ? decades(s, -1, 1) : decades(s, -3, 3);
  double scale = tf->kind == TC_KNOT_OPACITY ? 1
                 : chance(s, 0.6)            ? decades(s, -2, 2)
                                             : decades(s, -12, 12),
         at = between(s, -0.1, 1.1);
  c->n_knots = 1 + (size_t)pick(s, TEST_MAX_KNOTS);
  for (size_t i = 0; i < c->n_knots; i++) {
    tc_knot *k = &c->knots[i];
    k->value = at;
    k->amount = chance(s, 0.3) ? 0 : chance(s, 0.1) ? scale : scale * test_random(s);
    for (int j = 0; j < 3; j++) k->color[j] = chance(s, 0.2) ? 1 : test_random(s);
    if (chance(s, 0.75)) at += decades(s, -6, 0);
  }
}

static void draw_clip(test_case *c, uint64_t *s) {
  bool box = chance(s, 0.5);
  c->scene.clip.n_planes = c->scene.clip.has_box && (!box || chance(s, 0.3)) ? 1 + pick(s, 6) : 0;
  c->scene.clip.has_box = c->scene.clip.has_box && box;
  for (int k = 0; k < 3; k++) {
    double a = test_random(s), b = test_random(s);
    c->scene.clip.box[0][k] = fmin(a, b), c->scene.clip.box[1][k] = fmax(a, b); /* relative to the volume's extent */
  }
  for (int i = 0; i < c->scene.clip.n_planes; i++)
    for (int k = 0; k < 4; k++) c->scene.clip.planes[i][k] = between(s, -1, 1); /* d: relative, from the centre */
}

/* Draws the members on which programs are specialised. For members with a number (rays, termination, thickness, clip)
 * only whether they are used; draw_scene() draws the number. */
static void draw_style(test_case *c, uint64_t *s) {
  static const tc_mode modes[] = {TC_MODE_DVR, TC_MODE_DVR,   TC_MODE_DVR,     TC_MODE_DVR, TC_MODE_DVR,
                                  TC_MODE_MIP, TC_MODE_MINIP, TC_MODE_AVERAGE, TC_MODE_MPR, TC_MODE_ISOSURFACE};
  tc_scene *scene = &c->scene;
  c->type = (tc_voxel_type)pick(s, TC_VOXEL_TYPE_COUNT);
  c->projection = chance(s, 0.5) ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC;
  scene->mode = modes[pick(s, G_N_ELEMENTS(modes))];
  scene->image.linear_light = chance(s, 0.3);
  scene->image.transparent = chance(s, 0.3);
  scene->classification = chance(s, 0.4) ? TC_PREINTEGRATED : (tc_classification)pick(s, TC_CLASSIFICATION_COUNT);
  scene->order = chance(s, 0.7) ? TC_FRONT_TO_BACK : TC_BACK_TO_FRONT;
  scene->filter = (tc_filter)(chance(s, 0.5) ? TC_FILTER_LINEAR : pick(s, TC_FILTER_COUNT));
  scene->shading.model = (tc_shading_model)(chance(s, 0.6) ? TC_SHADING_NONE : pick(s, TC_SHADING_COUNT));
  scene->sampling.prefilter = chance(s, 0.5);
  scene->sampling.rays_per_pixel = chance(s, 0.4) ? 2 : 1;
  scene->sampling.jitter = chance(s, 0.3);
  scene->sampling.coherence = chance(s, 0.3);
  scene->sampling.termination = chance(s, 0.5);
  scene->mpr.thickness_mm = chance(s, 0.5);
  scene->mpr.projection = (tc_slab_projection)pick(s, TC_SLAB_PROJECTION_COUNT);
  scene->clip.has_box = chance(s, 0.25);
  c->labels.on = chance(s, 0.25);
  c->labels.type = (tc_voxel_type)pick(s, TC_F32);
  scene->shading.gradient = (tc_gradient)pick(s, TC_GRADIENT_COUNT);
}

static void draw_scene(tc_scene *scene, uint64_t *s) {
  static const int rays[] = {2, 3, 4, 5, 8, 16};
  scene->image.width = chance(s, 0.1) ? 1 : 1 + pick(s, 13);
  scene->image.height = chance(s, 0.1) ? 1 : 1 + pick(s, 11);
  scene->window.center = test_random(s), scene->window.width = decades(s, -6, 2); /* relative to the value range */
  scene->sampling.step = decades(s, -2, 2);
  if (scene->sampling.rays_per_pixel > 1) scene->sampling.rays_per_pixel = rays[pick(s, G_N_ELEMENTS(rays))];
  if (scene->sampling.termination > 0) scene->sampling.termination = decades(s, -4, -0.3);
  scene->skipping.block = chance(s, 0.5) ? 0 : 2 + pick(s, 8);
  scene->shading.light_at_camera = chance(s, 0.5);
  for (int k = 0; k < 3; k++) scene->shading.light[k] = between(s, -1, 1);
  scene->shading.ambient = test_random(s), scene->shading.diffuse = test_random(s);
  scene->shading.specular = test_random(s), scene->shading.shininess = between(s, 0, 100);
  scene->isosurface.value = test_random(s); /* relative to the value range */
  for (int c = 0; c < 3; c++) scene->isosurface.color[c] = test_random(s);
  scene->mpr.orientation = (tc_mpr_orientation)pick(s, TC_MPR_ORIENTATION_COUNT);
  for (int k = 0; k < 3; k++) scene->mpr.normal[k] = between(s, -1, 1), scene->mpr.up[k] = between(s, -1, 1);
  if (scene->mpr.thickness_mm > 0) scene->mpr.thickness_mm = decades(s, -2, 2);
  scene->mpr.zoom = decades(s, -1, 2);
}

static void draw_labels(test_case *c, uint64_t *s) {
  test_label_recipe *l = &c->labels;
  bool negative = l->type == TC_I8 || l->type == TC_I16, wide = l->type == TC_U16 && chance(s, 0.3);
  for (int k = 0; k < 3; k++) {
    l->dims[k] = chance(s, 0.2) ? 1 : 1 + pick(s, 9);
    l->size[k] = decades(s, -0.5, 0.5);
    l->shift[k] = between(s, -0.4, 0.4);
  }
  l->turned = chance(s, 0.4);
  l->count = 1 + pick(s, 5);
  l->first = wide ? 65530 : negative ? -2 : 0;
  l->slope = chance(s, 0.8) ? 1 : 2;
  l->intercept = chance(s, 0.8) ? 0 : -1;
  l->some_visible = chance(s, 0.4);
  c->scene.labels.opacity = chance(s, 0.2) ? 1 : test_random(s);
  c->scene.labels.n_colors = (size_t)pick(s, 5);
  c->scene.labels.n_visible = l->some_visible ? (size_t)pick(s, 5) : 0;
  for (uint32_t i = 0; i < 4; i++) {
    l->colors[i].label = i + (i > 1 && wide ? 65528 : 0);
    l->visible[i] = l->colors[(i * 3 + 1) % 4].label;
    for (int k = 0; k < 4; k++) l->colors[i].rgba[k] = chance(s, 0.3) ? pick(s, 2) : test_random(s);
  }
}

test_case test_case_random(uint64_t seed) {
  static const int tables[] = {0, 2, 3, 16, 33, 64, 100, 128, 200};
  uint64_t state = seed * 0x2545f4914f6cdd1du, *s = &state;
  uint64_t style = (seed / TEST_STYLE_SEEDS + 1) * 0x9e6c63d0876a9a47u;
  test_case c = {.seed = seed};
  test_scene(&c.scene, 1, 1);
  g_free(c.scene.transfer_function.points);
  c.scene.transfer_function.points = NULL;
  draw_style(&c, &style);
  draw_volume(&c, s);
  draw_scene(&c.scene, s);
  draw_knots(&c, s);
  draw_clip(&c, s);
  draw_labels(&c, s);
  c.table_size = tables[pick(s, G_N_ELEMENTS(tables))];
  for (int k = 0; k < 3; k++) c.side[k] = chance(s, 0.25) ? 0 : between(s, -0.5, 0.5);
  if (c.side[0] == 0 && c.side[1] == 0 && c.side[2] == 0) c.side[1] = -1;
  c.inside = chance(s, 0.8) ? 0 : between(s, 0.5, 0.99);
  c.zoom = chance(s, 0.3) ? 1 : decades(s, -0.8, 0);
  return c;
}

/* ---- making ---- */

static float odd_value(uint64_t *state) {
  static const float odd[] = {NAN, INFINITY, -INFINITY, FLT_MAX, -FLT_MAX, FLT_MIN, 0x1p-149f, 0};
  return odd[pick(state, G_N_ELEMENTS(odd))];
}

static double pattern_at(const test_case *c, double x, double y, double z, uint64_t *state) {
  switch (c->pattern) {
  case TEST_CONSTANT: return 0.5;
  case TEST_RAMP: return fmod(x / 11 + y / 37 + z / 101, 1);
  case TEST_LEVELS: return 0.5 * pick(state, 3);
  case TEST_SPIKES: return chance(state, 0.05);
  case TEST_NOISE:
  case TEST_ODD:
  case TEST_PATTERN_COUNT: break;
  }
  return test_random(state);
}

static void put_voxel(void *voxels, tc_voxel_type type, size_t i, double v) {
  switch (type) {
  case TC_U8: ((uint8_t *)voxels)[i] = (uint8_t)v; break;
  case TC_I8: ((int8_t *)voxels)[i] = (int8_t)v; break;
  case TC_U16: ((uint16_t *)voxels)[i] = (uint16_t)v; break;
  case TC_I16: ((int16_t *)voxels)[i] = (int16_t)v; break;
  case TC_F32: ((float *)voxels)[i] = (float)v; break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

static double value_at(const test_case *c, double share) {
  return c->slope * (c->lo + share * (c->hi - c->lo)) + c->intercept;
}

static int by_value(const void *a, const void *b) {
  double x = ((const tc_knot *)a)->value, y = ((const tc_knot *)b)->value;
  return (x > y) - (x < y);
}

/* The completed scene for the renderers; *c keeps relative values, so that it can be completed for another volume. */
static struct {
  tc_knot knots[TC_MAX_KNOTS];
  tc_scene shares;
} made;

static void complete_knots(const test_case *c) {
  for (size_t i = 0; i < c->n_knots; i++) {
    made.knots[i] = c->knots[i % TEST_MAX_KNOTS];
    if (c->n_knots > TEST_MAX_KNOTS) made.knots[i].value = (double)i / (double)(c->n_knots - 1);
    made.knots[i].value = value_at(c, made.knots[i].value);
  }
  qsort(made.knots, c->n_knots, sizeof *made.knots, by_value);
}

static void complete_labels(test_case *c) {
  if (!c->labels.on) {
    c->scene.labels.n_colors = c->scene.labels.n_visible = 0;
    return;
  }
  strcpy(c->scene.labels.volume, "labels");
  c->scene.labels.colors = c->labels.colors;
  c->scene.labels.visible = c->labels.some_visible ? c->labels.visible : NULL;
}

static void place_eye(test_case *c, const double lo[3], const double hi[3], const tc_volume *volume) {
  tc_camera *camera = &c->scene.camera;
  double at[3], eye[3], distance = 0;
  test_scene_frame(&c->scene, volume, c->projection, c->side);
  if (c->at_eye) {
    double target[3];
    for (int k = 0; k < 3; k++) at[k] = lo[k] + c->eye[k] * (hi[k] - lo[k]), target[k] = camera->target[k];
    tc_volume_index_to_lps(volume, at, eye);
    for (int k = 0; k < 3; k++) at[k] = lo[k] + c->place[k] * (hi[k] - lo[k]);
    if (c->at_place) tc_volume_index_to_lps(volume, at, target);
    test_scene_look(&c->scene, c->projection, eye, target, c->projection == TC_PERSPECTIVE ? 60 : camera->height_mm);
  }
  camera->fov_y_deg *= c->zoom;
  camera->height_mm *= c->zoom;
  if (c->fov_deg > 0) camera->fov_y_deg = c->fov_deg;
  for (int k = 0; k < 3; k++) {
    camera->position[k] += c->inside * (camera->target[k] - camera->position[k]);
    distance = hypot(distance, camera->position[k] - camera->target[k]);
  }
  double further = c->far_mm > 0 ? c->far_mm / distance : 1;
  for (int k = 0; k < 3; k++)
    camera->position[k] = camera->target[k] + further * (camera->position[k] - camera->target[k]);
  if (c->far_mm > 0) camera->fov_y_deg = atan(tan(camera->fov_y_deg * M_PI / 360) / further) * 360 / M_PI;
}

static void complete_scene(test_case *c, const tc_volume *volume) {
  tc_scene *scene = &c->scene;
  made.shares = *scene;
  complete_knots(c);
  complete_labels(c);
  scene->transfer_function.points = made.knots;
  scene->transfer_function.count = c->n_knots;
  double width = fabs(value_at(c, 1) - value_at(c, 0));
  scene->window.center = value_at(c, scene->window.center);
  scene->window.width *= width > 0 ? width : 1;
  scene->isosurface.value = value_at(c, scene->isosurface.value);
  double lo[3], hi[3], mid[3], center[3], corner[3], extent = 0;
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) mid[k] = 0.5 * (lo[k] + hi[k]);
  tc_volume_index_to_lps(volume, mid, center);
  tc_volume_index_to_lps(volume, hi, corner);
  for (int k = 0; k < 3; k++) extent = fmax(extent, fabs(corner[k] - center[k]));
  for (int i = 0; i < 2; i++)
    for (int k = 0; k < 3; k++) scene->clip.box[i][k] = center[k] + extent * (2 * scene->clip.box[i][k] - 1);
  for (int i = 0; i < scene->clip.n_planes; i++) {
    double *p = scene->clip.planes[i];
    p[3] = p[3] * extent - (p[0] * center[0] + p[1] * center[1] + p[2] * center[2]);
  }
  place_eye(c, lo, hi, volume);
  if (c->fine) return;
  /* At most some thousand samples per pixel, fewer for the cubic filter, which fetches 64 voxels. */
  double least = fmin(c->spacing[0], fmin(c->spacing[1], c->spacing[2])), diagonal = 0;
  for (int k = 0; k < 3; k++) diagonal += c->dims[k] * c->spacing[k];
  double most = (scene->filter == TC_FILTER_CUBIC ? 600 : 3000) / (1 + 0.2 * scene->sampling.rays_per_pixel);
  scene->sampling.step = fmax(scene->sampling.step, diagonal / least / most);
}

tc_volume *test_case_volume(test_case *c) {
  static const double sheared[9] = {0.8, -0.6, 0, 0.6, 0.8, -0.25881904510252074, 0, 0, 0.9659258262890683};
  tc_volume_desc desc = {.type = c->type, .slope = c->slope, .intercept = c->intercept, .frames = 1};
  for (int i = 0; i < 9; i++) desc.direction[i] = c->sheared ? sheared[i] : i % 4 == 0;
  memcpy(desc.dims, c->dims, sizeof desc.dims);
  memcpy(desc.spacing, c->spacing, sizeof desc.spacing);
  memcpy(desc.origin, c->origin, sizeof desc.origin);
  strcpy(desc.format, "demo");
  GError *error = NULL;
  tc_volume *volume = tc_volume_new(&desc, &error);
  if (!volume) {
    fprintf(stderr, "case %llu: %s\n", (unsigned long long)c->seed, error->message);
    exit(99);
  }
  uint64_t state = c->seed;
  size_t i = 0;
  for (int z = 0; z < c->dims[2]; z++)
    for (int y = 0; y < c->dims[1]; y++)
      for (int x = 0; x < c->dims[0]; x++, i++) {
        double v = c->lo + pattern_at(c, x, y, z, &state) * (c->hi - c->lo);
        if (c->type != TC_F32) v = nearbyint(v);
        put_voxel(tc_volume_voxels(volume), c->type, i, v);
        if (c->type == TC_F32 && c->pattern == TEST_ODD && chance(&state, 0.2))
          ((float *)tc_volume_voxels(volume))[i] = odd_value(&state);
      }
  tc_volume_seal(volume);
  complete_scene(c, volume);
  return volume;
}

tc_volume *test_case_labels(const test_case *c, const tc_volume *volume) {
  static const double turned[9] = {0.6, 0.8, 0, -0.8, 0.6, 0, 0, 0, 1};
  const test_label_recipe *l = &c->labels;
  tc_volume_desc desc = {.type = l->type, .slope = l->slope, .intercept = l->intercept, .frames = 1};
  double lo[3], hi[3], middle[3], corner[3], center[3];
  if (!l->on) return NULL;
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) middle[k] = 0.5 * (lo[k] + hi[k]);
  tc_volume_index_to_lps(volume, middle, center);
  tc_volume_index_to_lps(volume, hi, corner);
  for (int i = 0; i < 9; i++) desc.direction[i] = l->turned ? turned[i] : i % 4 == 0;
  for (int k = 0; k < 3; k++) {
    double extent = fmax(2 * fabs(corner[k] - center[k]), 1e-3) * l->size[k];
    desc.dims[k] = l->dims[k];
    desc.spacing[k] = extent / l->dims[k];
    desc.origin[k] = center[k];
  }
  for (int k = 0; k < 3; k++)
    for (int r = 0; r < 3; r++)
      desc.origin[r] -= (0.5 * (l->dims[k] - 1) + l->shift[k] * (l->dims[k] > 1 ? l->dims[k] - 1 : 1)) *
                        desc.spacing[k] * desc.direction[3 * r + k];
  strcpy(desc.format, "demo");
  tc_volume *labels = tc_volume_new(&desc, NULL);
  if (!labels) exit(99);
  uint64_t state = c->seed + 77;
  for (size_t i = 0; i < (size_t)l->dims[0] * (size_t)l->dims[1] * (size_t)l->dims[2]; i++)
    put_voxel(tc_volume_voxels(labels), l->type, i, l->first + pick(&state, l->count));
  tc_volume_seal(labels);
  return labels;
}

/* Restores the default of the member at a JSON pointer. */
static bool reset_member(tc_scene *s, const char *pointer) {
  if (!strcmp(pointer, "/classification")) s->classification = TC_PREINTEGRATED;
  else if (!strcmp(pointer, "/order")) s->order = TC_FRONT_TO_BACK;
  else if (!strcmp(pointer, "/filter")) s->filter = TC_FILTER_LINEAR;
  else if (!strcmp(pointer, "/mode")) s->mode = TC_MODE_DVR;
  else if (!strcmp(pointer, "/sampling/raysPerPixel")) s->sampling.rays_per_pixel = 1;
  else if (!strcmp(pointer, "/sampling/coherence")) s->sampling.coherence = false;
  else if (!strcmp(pointer, "/sampling/jitter")) s->sampling.jitter = false;
  else if (!strncmp(pointer, "/shading", 8)) s->shading.model = TC_SHADING_NONE;
  else return false;
  return true;
}

bool test_case_fit(test_case *c, char **refusal) {
  test_case fitted = *c;
  for (int attempt = 0; attempt < 12; attempt++) {
    tc_explanation plan;
    GError *error = NULL;
    tc_volume *volume = test_case_volume(&fitted);
    bool ok = tc_explain(volume, &fitted.scene, fitted.scene.image.width, fitted.scene.image.height, &plan, &error);
    fitted.scene = made.shares;
    tc_volume_unref(volume);
    if (ok) {
      *c = fitted;
      return true;
    }
    const char *pointer = tc_error_pointer(error) ? tc_error_pointer(error) : "";
    bool again = error->code == TC_ERROR_UNSUPPORTED && reset_member(&fitted.scene, pointer);
    if (!again) *refusal = g_strdup_printf("%d %s %s", error->code, pointer, error->message);
    g_clear_error(&error);
    if (!again) return false;
  }
  *refusal = g_strdup("0 the plan keeps refusing what was taken away");
  return false;
}

/* ---- shrinking ---- */

enum { STEP_COUNT = 38 };

/* Applies one simplification; an unchanged case means it does not apply. */
static void simplify(test_case *c, int step) {
  tc_scene *s = &c->scene;
  int k = step % 3;
  switch (step) {
  case 0: case 1: case 2: c->dims[k] = c->dims[k] > 1 ? c->dims[k] / 2 : 1; break;
  case 3: case 4: case 5: c->dims[k] -= c->dims[k] > 1; break;
  case 6: s->image.width = (s->image.width + 1) / 2; break;
  case 7: s->image.height = (s->image.height + 1) / 2; break;
  case 8: s->mode = TC_MODE_DVR; break;
  case 9: s->shading.model = TC_SHADING_NONE; break;
  case 10: s->filter = TC_FILTER_LINEAR; break;
  case 11: s->classification = TC_PREINTEGRATED; break;
  case 12: s->order = TC_FRONT_TO_BACK; break;
  case 13: s->sampling.termination = 0; break;
  case 14: s->sampling.jitter = s->sampling.coherence = false; break;
  case 15: s->sampling.rays_per_pixel = 1; break;
  case 16: s->clip.has_box = false; break;
  case 17: s->clip.n_planes -= s->clip.n_planes > 0; break;
  case 18: s->image.linear_light = s->image.transparent = false; break;
  case 19: s->sampling.step = 1; break;
  case 20: for (int j = 0; j < 3; j++) c->spacing[j] = 1; break;
  case 21: for (int j = 0; j < 3; j++) c->origin[j] = 0; break;
  case 22: c->sheared = false; break;
  case 23: c->slope = 1, c->intercept = 0; break;
  case 24: c->pattern = TEST_CONSTANT; break;
  case 25: c->inside = 0, c->zoom = 1; break;
  case 26: c->projection = TC_ORTHOGRAPHIC; break;
  case 27: c->side[0] = c->side[2] = 0, c->side[1] = -1; break;
  case 28: s->skipping.block = 0; break;
  case 29: s->transfer_function.unit_distance_mm = 1; break;
  case 30: if (c->n_knots > 1) c->n_knots--; break;
  case 31: if (c->n_knots > 1) memmove(c->knots, c->knots + 1, --c->n_knots * sizeof *c->knots); break;
  case 32: if (c->n_knots > 2) memmove(c->knots + 1, c->knots + 2, (--c->n_knots - 1) * sizeof *c->knots); break;
  case 34: c->labels.on = false; break;
  case 35: c->labels.dims[0] = c->labels.dims[1] = c->labels.dims[2] = 1; break;
  case 36: c->table_size = 0; break;
  case 37: s->shading.gradient = TC_GRADIENT_CELL; break;
  case 33:
    for (size_t i = 0; i < c->n_knots; i++) c->knots[i].color[0] = c->knots[i].color[1] = c->knots[i].color[2] = 1;
    break;
  }
}

test_case test_case_shrink(const test_case *c, bool (*fails)(test_case *c)) {
  test_case best = *c;
  for (bool smaller = true; smaller;) {
    smaller = false;
    for (int step = 0; step < STEP_COUNT; step++) {
      test_case less = best;
      simplify(&less, step);
      if (memcmp(&less, &best, sizeof best) == 0) continue;
      char *refusal = NULL;
      test_case fitted = less;
      if (test_case_fit(&fitted, &refusal) && fails(&fitted)) {
        best = fitted;
        smaller = true;
      }
      g_free(refusal);
    }
  }
  return best;
}

void test_case_print(test_case *c) {
  test_case shown = *c;
  static const char *const patterns[] = {"noise", "constant", "ramp", "levels", "spikes", "odd"};
  tc_volume *volume = test_case_volume(&shown);
  cJSON *scene = tcp_scene_write(&shown.scene);
  char *text = cJSON_PrintUnformatted(scene);
  printf(
      "  volume: seed %llu, %dx%dx%d %s, spacing %.9g %.9g %.9g, origin %.9g %.9g %.9g%s, slope %.9g, intercept %.9g, "
      "%s of %.9g..%.9g, table of %d\n  scene: %s\n",
      (unsigned long long)c->seed, c->dims[0], c->dims[1], c->dims[2], tc_voxel_type_name(c->type), c->spacing[0],
      c->spacing[1], c->spacing[2], c->origin[0], c->origin[1], c->origin[2], c->sheared ? ", sheared" : "", c->slope,
      c->intercept, patterns[c->pattern], c->lo, c->hi, c->table_size, text);
  if (c->labels.on)
    printf("  labels: %dx%dx%d %s%s, %d..%d, %g of them each and %g more\n", c->labels.dims[0], c->labels.dims[1],
           c->labels.dims[2], tc_voxel_type_name(c->labels.type), c->labels.turned ? ", turned" : "", c->labels.first,
           c->labels.first + c->labels.count - 1, c->labels.slope, c->labels.intercept);
  cJSON_free(text);
  cJSON_Delete(scene);
  tc_volume_unref(volume);
}
