/* The error meter against surfaces that formulas give: what it says of depths and outlines is what a formula says, within the
 * bounds of trilinear interpolation. Rays, spheres and the gyroid are computed here, without extraction, ray caster or
 * reference.
 *
 * The meter's truth is the trilinear field, which differs from the function by at most the sum over axes of h^2/8 times the
 * greatest second derivative. The first place of a ray where the function certainly has changed sides, and the first where the
 * field may have, are therefore bounds of the truth; a pixel where they lie far apart (the ray grazes the surface) gets no
 * depth, which the meter leaves out. */
#include "tests/support/test.h"

#include "renderer/quality/meter.h"
#include "renderer/raycast/subpixel.h"
#include "renderer/reference/reference.h"
#include "tests/support/grid.h"
#include "tests/support/renderers.h"

enum { SIDE = 56, PIXELS = SIDE * SIDE, VOXELS = 64 };

static const double middle = (VOXELS - 1) / 2.0;

/* ---- rays ---- */

typedef struct ray {
  double from[3], along[3]; /* along: unit */
} ray;

static void unit(double v[3]) {
  const double size = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
  for (int k = 0; k < 3; k++) v[k] /= size;
}

static void cross(const double a[3], const double b[3], double c[3]) {
  for (int k = 0; k < 3; k++) c[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static ray ray_of(const tc_camera *c, double px, double py) {
  double forward[3], right[3], up[3];
  for (int k = 0; k < 3; k++) forward[k] = c->target[k] - c->position[k];
  unit(forward);
  cross(forward, c->up, right), unit(right);
  cross(right, forward, up);
  const double half = c->projection == TC_PERSPECTIVE ? tan(c->fov_y_deg * M_PI / 360) : c->height_mm / 2;
  const double x = (2 * px / SIDE - 1) * half, y = (1 - 2 * py / SIDE) * half;
  ray r;
  for (int k = 0; k < 3; k++) {
    const double aside = x * right[k] + y * up[k];
    r.from[k] = c->position[k] + (c->projection == TC_PERSPECTIVE ? 0 : aside);
    r.along[k] = forward[k] + (c->projection == TC_PERSPECTIVE ? aside : 0);
  }
  unit(r.along);
  return r;
}

/* ---- surfaces ---- */

typedef struct place {
  enum { NONE, MET, UNSURE } is;
  double at, low, high; /* mm along the ray: of the function, and bounds of the field's */
} place;

/* Where the function is 0, or `level` inside of that. */
typedef place (*meet)(const ray *r, double level);

#define RADIUS 24.0
#define BEND 0.75 /* r^2 has second derivatives of 2: three times 2/8 */

static double squared(double x, double y, double z, const void *user) {
  return pow(x - middle, 2) + pow(y - middle, 2) + pow(z - middle, 2);
}

/* Half of the chord squared; *t: its middle. Level: the radius is so much less. */
static double chord(const ray *r, double radius, double *t) {
  double away = -radius * radius;
  *t = 0;
  for (int k = 0; k < 3; k++) *t += (middle - r->from[k]) * r->along[k];
  for (int k = 0; k < 3; k++) away += pow(r->from[k] + *t * r->along[k] - middle, 2);
  return -away;
}

static place meet_sphere(const ray *r, double level) {
  double t;
  const double s2 = chord(r, RADIUS - level, &t);
  if (s2 < -BEND) return (place){.is = NONE};
  if (s2 < 4 * BEND) return (place){.is = UNSURE};
  return (place){MET, t - sqrt(s2), t - sqrt(s2 + BEND), t - sqrt(s2 - BEND)};
}

#define PERIOD 48.0

static double gyroid(double x, double y, double z, const void *user) {
  const double k = 2 * M_PI / PERIOD;
  return sin(k * x) * cos(k * y) + sin(k * y) * cos(k * z) + sin(k * z) * cos(k * x);
}

static double gyroid_at(const ray *r, double t) {
  return gyroid(r->from[0] + t * r->along[0], r->from[1] + t * r->along[1], r->from[2] + t * r->along[2], NULL);
}

/* Each second derivative is at most 2 k^2. Steps are so short that between two of them the function, whose slope is at most 4 k,
 * moves by little. */
static place meet_gyroid(const ray *r, double level) {
  const double k = 2 * M_PI / PERIOD, step = 0.02, slack = 3 * 2 * k * k / 8 + 4 * k * step / 2;
  double enter = 0, leave = INFINITY;
  for (int i = 0; i < 3; i++) {
    const double a = -r->from[i] / r->along[i], b = (VOXELS - 1 - r->from[i]) / r->along[i];
    enter = fmax(enter, fmin(a, b)), leave = fmin(leave, fmax(a, b));
  }
  if (!(enter < leave)) return (place){.is = leave - enter < -1 ? NONE : UNSURE};
  const double first = gyroid_at(r, enter) - level, side = first < 0 ? -1 : 1;
  if (fabs(first) < slack) return (place){.is = UNSURE};
  place p = {.is = MET, .low = NAN, .at = NAN};
  for (double t = enter; t < leave; t += step) {
    const double value = side * (gyroid_at(r, t) - level);
    if (isnan(p.low) && value < slack) p.low = t - step;
    if (isnan(p.at) && value < 0) p.at = t - step / 2;
    if (value < -slack) return (p.high = t, p.high - p.low < 1) ? p : (place){.is = UNSURE};
  }
  return (place){.is = isnan(p.low) ? NONE : UNSURE};
}

/* ---- what the meter has to say ---- */

typedef struct expected {
  double off[PIXELS], slack[PIXELS]; /* of pixels with a surface in picture and truth */
  int both, one;
} expected;

static int compare_doubles(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static double rms_of(const double *x, int n) {
  double sum = 0;
  for (int i = 0; i < n; i++) sum += x[i] * x[i] / n;
  return sqrt(sum);
}

/* 99 of 100 of |off| + sign * slack are at most that. */
static double p99_of(const expected *e, int sign) {
  static double x[PIXELS];
  for (int i = 0; i < e->both; i++) x[i] = e->off[i] + sign * e->slack[i];
  qsort(x, (size_t)e->both, sizeof *x, compare_doubles);
  return x[(e->both * 99 + 99) / 100 - 1];
}

static void expect(expected *e, double drawn, const place *truth) {
  e->one += isfinite(drawn) != (truth->is == MET);
  if (!isfinite(drawn) || truth->is != MET) return;
  e->off[e->both] = fabs(drawn - truth->at);
  e->slack[e->both++] = fmax(truth->at - truth->low, truth->high - truth->at) + 1e-4; /* single precision */
}

static void assert_says(const char *what, const tc_depth_error *said, const expected *e) {
  const double rms = rms_of(e->off, e->both), slack = rms_of(e->slack, e->both);
  print_message("  %s: %d pixels, %d at the outline: meter %.4f mm rms, 99 %% within %.4f; formula %.4f (within %.4f) and %.4f to %.4f\n",
                what, said->both, said->one, said->rms, said->p99, rms, slack, p99_of(e, -1), p99_of(e, 1));
  assert_int_equal(said->both, e->both);
  assert_int_equal(said->one, e->one);
  assert_true(fabs(said->rms - rms) <= slack); /* the triangle inequality of rms */
  assert_true(said->p99 >= p99_of(e, -1) && said->p99 <= p99_of(e, 1));
}

static tc_meter_result measure(const tc_frame *frame, tc_volume *volume, const tc_scene *scene) {
  GError *error = NULL;
  tc_meter_result found;
  tc_meter *meter = tc_meter_new(frame, PIXELS, 1);
  if (!tc_meter_measure(meter, &(tc_meter_subject){.volume = volume, .scene = scene}, 0, &found, &error))
    fail_msg("%s", error->message);
  tc_meter_free(meter);
  return found;
}

static float linear[PIXELS][4], depth[PIXELS];
static tc_frame by_formula = {.width = SIDE, .height = SIDE, .linear = linear[0], .depth = depth};

static tc_volume *grid_of(test_field field) {
  return test_volume(&(test_grid){.dims = {VOXELS, VOXELS, VOXELS}, .type = TC_F32}, field, NULL);
}

static void look_at(tc_scene *scene, tc_projection projection, tc_mode mode, double value) {
  test_scene(scene, SIDE, SIDE);
  test_scene_look(scene, projection, (double[3]){middle - 60, middle - 110, middle + 40}, (double[3]){middle, middle, middle},
                  projection == TC_PERSPECTIVE ? 35 : 75);
  scene->mode = mode, scene->isosurface.value = value;
}

/* ---- tests ---- */

static const struct {
  const char *name;
  test_field field;
  meet meet;
  double value, level; /* of the surface that is drawn instead */
} surfaces[2] = {{"sphere", squared, meet_sphere, RADIUS *RADIUS, -0.6}, {"gyroid", gyroid, meet_gyroid, 0, 0.2}};

/* Drawn is another surface than the scene's, exactly: how far apart the two are is known, and where only one of them is. */
TEST(another_surface_is_as_far_off_as_it_is) {
  for (int i = 0; i < 4; i++) {
    const int s = i / 2;
    g_autoptr(tc_volume) volume = grid_of(surfaces[s].field);
    g_auto(tc_scene) scene;
    static expected e;
    e.both = e.one = 0;
    look_at(&scene, i % 2 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE, i % 2 ? TC_MODE_MESH : TC_MODE_ISOSURFACE, surfaces[s].value);
    for (int p = 0; p < PIXELS; p++) {
      const ray r = ray_of(&scene.camera, p % SIDE + 0.5, p / SIDE + 0.5);
      const place truth = surfaces[s].meet(&r, 0), drawn = surfaces[s].meet(&r, surfaces[s].level);
      depth[p] = truth.is == UNSURE || drawn.is == UNSURE ? NAN : drawn.is == MET ? (float)drawn.at : INFINITY;
      if (!isnan(depth[p])) expect(&e, drawn.is == MET ? drawn.at : INFINITY, &truth);
    }
    const tc_meter_result said = measure(&by_formula, volume, &scene);
    assert_true(e.both > PIXELS / 10 && e.one > 5 && rms_of(e.slack, e.both) < rms_of(e.off, e.both) / 4);
    assert_says(surfaces[s].name, &said.depth, &e);
    assert_int_equal(said.n_surfaces, 1);
  }
}

/* Drawn is the mesh: how far it is from the formula is what the meter says, so that the meter has the mesh's error right. */
TEST(a_mesh_is_as_far_off_as_the_formula_says) {
  for (int s = 0; s < 2; s++) {
    g_autoptr(tc_volume) volume = grid_of(surfaces[s].field);
    g_auto(tc_scene) scene;
    static expected e;
    e.both = e.one = 0;
    look_at(&scene, TC_PERSPECTIVE, TC_MODE_MESH, surfaces[s].value);
    tc_frame *frame = test_draw(test_widest(), volume, &scene, &(tc_render_request){.want_linear = true, .want_depth = true}, NULL);
    for (int p = 0; p < PIXELS; p++) {
      const ray r = ray_of(&scene.camera, p % SIDE + 0.5, p / SIDE + 0.5);
      const place truth = surfaces[s].meet(&r, 0);
      if (truth.is == UNSURE) frame->depth[p] = NAN;
      else expect(&e, (double)frame->depth[p], &truth);
    }
    const tc_meter_result said = measure(frame, volume, &scene);
    assert_true(e.both > PIXELS / 10 && e.one == 0);
    assert_says(surfaces[s].name, &said.depth, &e);
  }
}

/* Four samples: the nearest has the pixel's depth; the depth of their mean is wrong by the distance between the two. */
TEST(several_samples_have_the_depth_of_the_nearest) {
  const double apart[3] = {-0.7, 0, 0.5};
  g_autoptr(tc_volume) volume = grid_of(squared);
  g_auto(tc_scene) scene;
  tc_subpixel rays[4];
  tc_subpixel_rays(4, rays);
  look_at(&scene, TC_ORTHOGRAPHIC, TC_MODE_MESH, surfaces[0].value);
  scene.sampling.rays_per_pixel = 4;
  for (int round = 0; round < 3; round++) {
    static expected e;
    e.both = e.one = 0;
    for (int p = 0; p < PIXELS; p++) {
      place nearest = {.is = UNSURE, .at = INFINITY}, one = {0};
      int met = 0;
      double mean = 0, slack = 0;
      for (int i = 0; i < 4; i++) {
        const ray r = ray_of(&scene.camera, p % SIDE + 0.5 + rays[i].x, p / SIDE + 0.5 + rays[i].y);
        one = meet_sphere(&r, 0);
        met += one.is == MET;
        mean += one.at / 4, slack = fmax(slack, one.high - one.low);
        if (one.is == MET && one.at < nearest.at) nearest = one;
      }
      depth[p] = NAN;
      if (met < 4) continue;
      const double drawn = (round == 1 ? mean : nearest.at) + apart[round];
      depth[p] = (float)drawn;
      e.off[e.both] = fabs(drawn - nearest.at), e.slack[e.both++] = slack;
    }
    const tc_meter_result said = measure(&by_formula, volume, &scene);
    assert_true(e.both > PIXELS / 10);
    assert_says(round == 1 ? "mean" : round ? "behind" : "before", &said.depth, &e);
  }
}

/* Two spheres about one centre, the outer one cut open before the inner one, which are drawn too far and too near. */
TEST(each_surface_has_an_error_of_its_own) {
  enum { INNER = 9, CUT = 15 };
  g_autoptr(tc_volume) volume = grid_of(squared);
  g_auto(tc_scene) scene;
  const tc_mesh_surface list[3] = {{.value = 1, .opacity = 1},
                                   {.value = RADIUS * RADIUS, .opacity = 1, .visible = true, .two_sided = true},
                                   {.value = INNER * INNER, .opacity = 0.5, .visible = true, .two_sided = true}};
  look_at(&scene, TC_ORTHOGRAPHIC, TC_MODE_MESH, 0);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){middle, -50, middle}, (double[3]){middle, middle, middle}, 75);
  scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -(middle - CUT), scene.clip.n_planes = 1;
  tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 3);
  static expected e[2];
  for (int p = 0; p < PIXELS; p++) {
    double t;
    const ray r = ray_of(&scene.camera, p % SIDE + 0.5, p / SIDE + 0.5);
    const double outer = chord(&r, RADIUS, &t), inner = chord(&r, INNER, &t);
    depth[p] = outer < -BEND ? INFINITY : NAN;
    if (outer < 4 * BEND || fabs(inner) < 4 * BEND || fabs(sqrt(outer) - CUT) < 1) continue;
    const bool is_inner = inner > 0, open = sqrt(outer) > CUT;
    const double s2 = is_inner ? inner : outer, side = open && !is_inner ? 1 : -1;
    const double low = sqrt(s2 - BEND), high = sqrt(s2 + BEND);
    const place truth = {MET, t + side * sqrt(s2), t + side * (side > 0 ? low : high), t + side * (side > 0 ? high : low)};
    const double drawn = truth.at + (is_inner ? -0.6 : 0.3);
    depth[p] = (float)drawn;
    expect(&e[is_inner], drawn, &truth);
  }
  const tc_meter_result said = measure(&by_formula, volume, &scene);
  assert_int_equal(said.n_surfaces, 2);
  assert_true(said.surfaces[0].surface == 1 && said.surfaces[1].surface == 2);
  assert_says("outer", &said.surfaces[0], &e[0]);
  assert_says("inner", &said.surfaces[1], &e[1]);
  assert_int_equal(said.depth.both, e[0].both + e[1].both);
}

/* Where a ray meets two translucent spheres about one centre, front to back; false: it grazes one of them. */
static bool meet_two(const ray *r, double inner_radius, place met[4], int *n) {
  double t;
  const double of[2] = {chord(r, RADIUS, &t), chord(r, inner_radius, &t)};
  *n = 0;
  for (int i = 0; i < 2; i++)
    if (of[i] > -BEND && of[i] < 4 * BEND) return false;
  for (int i = 0; i < 4; i++) {
    const double s2 = of[i % 3 != 0], side = i < 2 ? -1 : 1;
    if (s2 > 0) met[(*n)++] = (place){MET, t + side * sqrt(s2), t + side * sqrt(s2 - side * BEND), t + side * sqrt(s2 + side * BEND)};
  }
  return true;
}

static void look_at_two(tc_scene *scene, double inner) {
  const tc_mesh_surface list[2] = {{.value = inner * inner, .opacity = 0.3, .visible = true, .two_sided = true},
                                   {.value = RADIUS * RADIUS, .opacity = 0.5, .visible = true, .two_sided = true}};
  look_at(scene, TC_ORTHOGRAPHIC, TC_MODE_MESH, 0);
  tc_scene_set_surfaces(scene, g_memdup2(list, sizeof list), 2);
}

static float layers[PIXELS][TC_FRAME_LAYERS];

/* Each layer is drawn off by another distance, and some pixels lack the last. */
TEST(each_layer_is_as_far_off_as_it_is) {
  enum { INNER = 12 };
  static const double off[4] = {0.3, -0.6, 0.9, -1.2};
  g_autoptr(tc_volume) volume = grid_of(squared);
  g_auto(tc_scene) scene;
  static expected e[4];
  tc_frame frame = by_formula;
  frame.layers = layers;
  look_at_two(&scene, INNER);
  for (int p = 0; p < PIXELS; p++) {
    const ray r = ray_of(&scene.camera, p % SIDE + 0.5, p / SIDE + 0.5);
    place met[4];
    int n;
    depth[p] = NAN;
    if (!meet_two(&r, INNER, met, &n)) continue;
    const int drawn = n == 4 && p % 16 == 0 ? 3 : n;
    for (int i = 0; i < 4; i++) {
      layers[p][i] = i < drawn ? (float)(met[i].at + off[i]) : INFINITY;
      if (i < n) expect(&e[i], i < drawn ? met[i].at + off[i] : INFINITY, &met[i]);
    }
    depth[p] = layers[p][0];
  }
  const tc_meter_result said = measure(&frame, volume, &scene);
  assert_int_equal(said.n_layers, 4);
  for (int i = 0; i < 4; i++) assert_says("layer", &said.layers[i], &e[i]);
  assert_true(e[3].one > 5 && e[2].one == 0 && e[1].both > e[2].both);
  assert_int_equal(measure(&by_formula, volume, &scene).n_layers, 0);
}

/* What is drawn has its layers where the formula has them. An opaque surface is the last, and several rays have none. */
TEST(drawn_layers_are_as_far_off_as_the_formula_says) {
  enum { INNER = 12 };
  const tc_render_request request = {.want_linear = true, .want_depth = true};
  g_autoptr(tc_volume) volume = grid_of(squared);
  g_auto(tc_scene) scene;
  look_at_two(&scene, INNER);
  for (int opaque = 0; opaque < 2; opaque++) {
    static expected e[4];
    memset(e, 0, sizeof e);
    if (opaque) scene.mesh.surfaces[0].opacity = 1;
    tc_frame *frame = test_draw(test_widest(), volume, &scene, &request, NULL);
    assert_non_null(frame->layers);
    for (int p = 0; p < PIXELS; p++) {
      const ray r = ray_of(&scene.camera, p % SIDE + 0.5, p / SIDE + 0.5);
      place met[4];
      int n = 0;
      if (!meet_two(&r, INNER, met, &n)) frame->depth[p] = NAN;
      if (isnan(frame->depth[p])) continue;
      if (opaque && n == 4) n = 2;
      for (int i = 0; i < 4; i++) {
        if (i < n) expect(&e[i], (double)frame->layers[p][i], &met[i]);
        else assert_true(isinf(frame->layers[p][i]));
      }
    }
    const tc_meter_result said = measure(frame, volume, &scene);
    assert_int_equal(said.n_layers, opaque ? 2 : 4);
    for (int i = 0; i < said.n_layers; i++) assert_says("layer", &said.layers[i], &e[i]);
    assert_true(said.n_layers == 2 || (e[2].both > 0 && e[2].both == e[3].both));
  }
  scene.sampling.rays_per_pixel = 4;
  assert_null(test_draw(test_widest(), volume, &scene, &request, NULL)->layers);
}

/* ---- labels: the truth is computed from the definition, without the extraction's fields and boxes ---- */

static double in_a_box(double x, double y, double z, const void *user) {
  return x >= 6 && x < 58 && y >= 20 && y < 44 && z >= 6 && z < 58 ? 3 : 0;
}

/* Two labels that meet in a plane, and a thin sheet. */
static double halves_and_sheet(double x, double y, double z, const void *user) {
  if (pow(x - middle, 2) + pow(y - middle, 2) + pow(z - middle, 2) < 400) return x > middle ? 2 : 1;
  return z == 8 ? 5 : 0;
}

static void look_at_labels(tc_scene *scene) {
  look_at(scene, TC_ORTHOGRAPHIC, TC_MODE_MESH, 0);
  g_strlcpy(scene->labels.volume, "labels", sizeof scene->labels.volume);
}

static tc_meter_result measure_labels(const tc_frame *frame, tc_volume *labels, const tc_scene *scene, const atomic_bool *cancel, GError **error) {
  tc_meter_result found;
  tc_meter *meter = tc_meter_new(frame, PIXELS, 1);
  tc_meter_measure(meter, &(tc_meter_subject){.volume = labels, .labels = labels, .scene = scene, .cancel = cancel}, 0, &found, error);
  tc_meter_free(meter);
  return found;
}

/* Away from its edges the face of a box is in the middle between voxels, whatever smooths it, as the filter and distances are
 * of both sides alike. */
TEST(the_face_of_a_labels_box_is_between_its_voxels) {
  g_autoptr(tc_volume) labels = test_volume(&(test_grid){.dims = {VOXELS, VOXELS, VOXELS}, .type = TC_U8, .slope = 1}, in_a_box, NULL);
  g_auto(tc_scene) scene;
  look_at_labels(&scene);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){middle, -50, middle}, (double[3]){middle, middle, middle}, 75);
  int n = 0;
  for (int p = 0; p < PIXELS; p++) {
    const ray r = ray_of(&scene.camera, p % SIDE + 0.5, p / SIDE + 0.5);
    const bool inner = fabs(r.from[0] - middle) < 8 && fabs(r.from[2] - middle) < 8;
    depth[p] = inner ? (float)(50 + 19.5) : NAN;
    n += inner;
  }
  const tc_meter_result said = measure_labels(&by_formula, labels, &scene, NULL, NULL);
  print_message("  %d pixels, %.1e mm off at most\n", said.depth.both, said.depth.max);
  assert_true(n > 100 && said.depth.both == n && said.depth.one == 0 && said.depth.max < 1e-4);
  assert_true(said.n_surfaces == 1 && said.surfaces[0].label == 3);
}

/* The extraction's fields are of whole numbers of 1/256 voxel, rounded four times; the field falls by at least a third of a
 * voxel for each. Slices that lie far apart are not smoothed across. The scene shows two labels of three. */
TEST(meshes_of_labels_are_near_their_definition) {
  static const double spacings[3][3] = {{1, 1, 1}, {1, 0.8, 1.4}, {0.6, 0.6, 1.5}};
  for (int i = 0; i < 3; i += STRIDE(2)) {
    test_grid grid = {.dims = {VOXELS, VOXELS, VOXELS}, .type = i ? TC_I16 : TC_U8, .slope = 1};
    memcpy(grid.spacing, spacings[i], sizeof grid.spacing);
    g_autoptr(tc_volume) labels = test_volume(&grid, halves_and_sheet, NULL);
    g_auto(tc_scene) scene;
    look_at_labels(&scene);
    const double centre[3] = {middle * grid.spacing[0], middle * grid.spacing[1], middle * grid.spacing[2]};
    test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){centre[0] - 60, centre[1] - 90, centre[2] + 40}, centre, 70);
    tc_scene_set_visible(&scene, g_memdup2((const uint32_t[2]){1, 5}, 2 * sizeof(uint32_t)), 2);
    tc_frame *frame = test_draw(test_widest(), labels, &scene,
                                &(tc_render_request){.labels = labels, .want_linear = true, .want_depth = true}, NULL);
    const tc_meter_result said = measure_labels(frame, labels, &scene, NULL, NULL);
    for (int k = 0; k < said.n_surfaces; k++)
      print_message("  spacing %g %g %g, label %u: %d pixels, half within %.4f mm, 99 %% within %.4f; %d at the outline\n",
                    grid.spacing[0], grid.spacing[1], grid.spacing[2], said.surfaces[k].label, said.surfaces[k].both,
                    said.surfaces[k].p50, said.surfaces[k].p99, said.surfaces[k].one);
    assert_int_equal(said.n_surfaces, 2);
    for (int k = 0; k < 2; k++)
      assert_true(said.surfaces[k].label != 2 && said.surfaces[k].p50 < 3 * 4 / 256.0 && said.surfaces[k].both > 100);
    assert_true(said.depth.outline < 0.01);
  }
}

/* Blocks of the labels' fields are made by whichever thread asks first: any number of threads see the same picture. */
TEST(threads_share_the_truth_of_labels) {
  enum { SIDES = SANITIZED ? VOXELS / 2 : VOXELS }; /* the volume's blocks take the time */
  static float pictures[2][PIXELS][4];
  g_autoptr(tc_volume) labels = test_volume(&(test_grid){.dims = {SIDES, SIDES, SIDES}, .type = TC_U8, .slope = 1}, halves_and_sheet, NULL);
  g_auto(tc_scene) scene;
  double covered = 0;
  look_at_labels(&scene);
  for (int i = 0; i < 2; i++) {
    g_autoptr(tc_reference) reference =
        tc_meter_reference(&(tc_meter_subject){.volume = labels, .labels = labels, .scene = &scene}, SIDE, SIDE, NULL);
    assert_true(tc_reference_image(reference, i ? 4 : 1, pictures[i][0], NULL));
  }
  for (int p = 0; p < PIXELS; p++) covered += (double)pictures[0][p][3];
  assert_true(covered > PIXELS / 10);
  assert_memory_equal(pictures[0], pictures[1], sizeof pictures[0]);
}

TEST(a_truth_of_labels_ends_when_told) {
  g_autoptr(tc_volume) labels = test_volume(&(test_grid){.dims = {VOXELS, VOXELS, VOXELS}, .type = TC_U8, .slope = 1}, in_a_box, NULL);
  g_auto(tc_scene) scene;
  g_autoptr(GError) error = NULL;
  const atomic_bool cancel = true;
  look_at_labels(&scene);
  for (int p = 0; p < PIXELS; p++) depth[p] = INFINITY;
  measure_labels(&by_formula, labels, &scene, &cancel, &error);
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED));
}

TESTS(test_renderers_open, test_renderers_close)
