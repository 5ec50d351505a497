/* Stiff and extreme cases (NUMERICS section 5), each in every way of rendering on every back end and instruction set,
 * against the invariants of every picture (tests/support/judge.h). What has no meaning is refused, and the member
 * named. */
#include "tests/support/test.h"

#include "tests/support/grid.h"
#include "tests/support/judge.h"

/* Every how many cases of a row a way draws, other ones in other ways: all with TC_LONG. */
enum { SPARSE = SANITIZED ? 29 : 5 };
static int stride(void) { return getenv("TC_LONG") ? 1 : SPARSE; }

/* A plain scene over noise, which each case then bends. */
static test_case plain_case(uint64_t seed, tc_voxel_type type) {
  test_case c = {.seed = 5 + seed, .dims = {9, 8, 7}, .type = type, .spacing = {1, 1, 1}, .slope = 1, .lo = 0,
                 .hi = type == TC_F32 ? 1 : 100, .side = {0.4, -1, 0.3}, .zoom = 1, .n_knots = 3};
  c.knots[0] = (tc_knot){0.2, {0.2, 0.4, 1}, 0};
  c.knots[1] = (tc_knot){0.5, {1, 0.8, 0.1}, 0.4};
  c.knots[2] = (tc_knot){0.9, {1, 1, 1}, 0.1};
  test_scene(&c.scene, 7, 5);
  g_free(c.scene.transfer_function.points);
  c.scene.transfer_function = (tc_transfer_function){.kind = TC_KNOT_EXTINCTION, .unit_distance_mm = 1};
  c.scene.window.center = 0.5, c.scene.window.width = 0.8; /* of the range */
  c.scene.isosurface.value = 0.45;
  c.scene.mpr.zoom = 1;
  return c;
}

/* ---- the cases: each bends number i of its `count` ---- */

static void optical_depth(test_case *c, int i) {
  c->scene.transfer_function.kind = TC_KNOT_EXTINCTION;
  for (int k = 0; k < 3; k++) c->knots[k].amount *= pow(10, 3 * i - 12);
  c->pattern = TEST_LEVELS;
}

static void opacity_to_one(test_case *c, int i) {
  c->scene.transfer_function.kind = TC_KNOT_OPACITY;
  c->scene.transfer_function.unit_distance_mm = pow(10, 3 * i - 6);
  for (size_t k = 0; k < c->n_knots; k++) c->knots[k].amount = fmin(c->knots[k].amount, 1);
  c->knots[1 % c->n_knots].amount = 1;
}

static void span(test_case *c, int i) {
  static const double spans[][4] = {{5, 5, 1, 0},           {1, 1.00000012, 1, 0}, {-0x1p31, 0x1p31, 1, 0},
                                    {0, 1000, 1e-9, 0},     {0, 1000, 1e9, -5e11}, {0, 1000, -2, 1000},
                                    {1e5, 1e5 + 1, 1, 0},   {0, 0x1p-149, 1, 0},   {-3e38, 3e38, 1, 0},
                                    {0, 1e-30, 1e-9, 1e-20}};
  c->lo = spans[i][0], c->hi = spans[i][1], c->slope = spans[i][2], c->intercept = spans[i][3];
}

static void slope_of_whole_numbers(test_case *c, int i) {
  static const double slopes[] = {1e-9, 1e9, -1, -1e-9};
  c->type = TC_U16;
  c->lo = 0, c->hi = 30000;
  c->slope = slopes[i], c->intercept = -1000 * slopes[i];
}

static void pattern(test_case *c, int i) { c->pattern = (test_pattern)i; }

static void narrow_knots(test_case *c, int i) {
  c->type = TC_U16;
  c->lo = 0, c->hi = 65535;
  c->subtables = true;
  c->scene.transfer_function.kind = TC_KNOT_EXTINCTION;
  c->pattern = i == 3 ? TEST_RAMP : TEST_NOISE;
  c->n_knots = TEST_MAX_KNOTS;
  for (size_t k = 0; k < c->n_knots; k++) { /* a step; pairs at one value; values one wide, one after another */
    double at = i == 0 ? 0.5 : i == 1 ? 0.1 + 0.15 * (double)(k / 2) : 0.3 + (double)k / 65535;
    c->knots[k] = (tc_knot){at, {1, k % 2, 0.5}, k % 2 ? 1000 : 0};
  }
}

static void knots(test_case *c, int i) {
  static const size_t counts[] = {1, TEST_MAX_KNOTS, TEST_MAX_KNOTS, TC_MAX_KNOTS};
  c->n_knots = counts[i];
  c->scene.transfer_function.kind = TC_KNOT_EXTINCTION;
  for (size_t k = 0; k < TEST_MAX_KNOTS; k++) /* one; clear; opaque from the first sample; as many as there may be */
    c->knots[k] = (tc_knot){i == 0 ? 0.5 : (double)k / TEST_MAX_KNOTS,
                            {k % 3, 0.5, 1},
                            i == 0   ? 0.5
                            : i == 1 ? 0
                            : i == 2 ? 1e9
                                     : k % 2};
  for (size_t k = 0; k < TEST_MAX_KNOTS; k++) c->knots[k].color[0] *= 0.5;
}

static void shape(test_case *c, int i) {
  static const int shapes[][3] = {{1, 1, 1}, {1, 9, 1}, {7, 1, 5}, {2, 2, 2}, {2048, 2, 1}, {1, 1, 2048}};
  memcpy(c->dims, shapes[i / 2], sizeof c->dims);
  if (i % 2) c->spacing[i / 2 % 3] = 1000;
}

static void step(test_case *c, int i) {
  static const double steps[] = {1e-3, 17, 1e3};
  c->scene.sampling.step = steps[i];
  if (i > 0) return;
  c->fine = true; /* some thousand samples a ray of so small a volume */
  c->dims[0] = c->dims[1] = c->dims[2] = 3;
  c->spacing[0] = c->spacing[1] = c->spacing[2] = 1;
  c->scene.image.width = c->scene.image.height = 2;
}

static void picture(test_case *c, int i) {
  static const int sizes[][2] = {{1, 1}, {8192, 1}, {1, 300}};
  c->scene.image.width = sizes[i][0], c->scene.image.height = sizes[i][1];
  if (i != 1) return;
  c->scene.sampling.step = 4;
  c->scene.sampling.rays_per_pixel = 1;
  c->zoom = 5e-4; /* so that a quarter of the pixels meets the volume */
}

/* Outside along an axis and along diagonals; inside; on a face, on an edge, on a corner; far away. */
static void eye(test_case *c, int i) {
  static const double sides[][3] = {{0, -1, 0}, {0, 0, 1}, {1, 0, 0}, {1, 1, 0}, {1, 1, 1}};
  static const double places[][3] = {{0.6, 0.3, 0.4}, {0, 0.5, 0.5}, {0.3, 1, 0.6}, {1, 1, 0.5}, {0, 0, 1}, {1, 0, 0}};
  c->projection = i % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC;
  i /= 2;
  if (i < 5) memcpy(c->side, sides[i], sizeof c->side);
  else if (i < 11) c->at_eye = true, memcpy(c->eye, places[i - 5], sizeof c->eye);
  else c->far_mm = i == 11 ? 1e5 : 1e7;
}

/* The ray of the middle pixel meets the box where its sides meet, or lies in one. */
static void edge(test_case *c, int i) {
  static const struct { double eye[3], place[3]; } views[] = {
      {{2, 2, 0.5}, {1, 1, 0.5}},         /* from outside in through an edge, and out through the opposite one */
      {{2, 2, 2}, {1, 1, 1}},             /* through a corner */
      {{0, 2, 0.5}, {1, 1, 0.5}},         /* past an edge, touching it; past a corner */
      {{0, 2, 1.5}, {1, 1, 1}},
      {{-1, 0.5, 1}, {0.5, 0.5, 1}},      /* along a face; across it from corner to corner; along an edge */
      {{-1, -1, 1}, {0.5, 0.5, 1}},
      {{-1, 1, 1}, {0.5, 1, 1}},
      {{0.5, 0.5, 0.5}, {1, 1, 0.5}},     /* from within out through an edge, through a corner */
      {{0.5, 0.5, 0.5}, {0, 0, 0}},
      {{0.25, 0.5, 1}, {1, 0.5, 1}},      /* on a face along it, on an edge along it */
      {{0.25, 1, 1}, {1, 1, 1}},
      {{0, 0, 0}, {1, 1, 1}},             /* from corner to corner; away from one */
      {{1, 1, 1}, {2, 2, 2}}};
  c->dims[0] = c->dims[1] = c->dims[2] = 9;
  c->projection = i % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC;
  c->at_eye = c->at_place = true;
  memcpy(c->eye, views[i / 2].eye, sizeof c->eye);
  memcpy(c->place, views[i / 2].place, sizeof c->place);
}

static void field_of_view(test_case *c, int i) {
  static const double degrees[] = {1e-3, 179, 90};
  c->projection = TC_PERSPECTIVE;
  c->fov_deg = degrees[i];
}

static const struct row {
  const char *name;
  int count;
  void (*bend)(test_case *c, int i);
} rows[] = {{"optical depths of 1e-12 to 1e12", 9, optical_depth},
            {"opacity 1 over 1e-6 to 1e6 mm", 5, opacity_to_one},
            {"spans of 0, 1 ulp, 2^32, 6e38", 10, span},
            {"slopes of whole numbers", 4, slope_of_whole_numbers},
            {"constant, equal, NaN, infinite", TEST_PATTERN_COUNT, pattern},
            {"steps and peaks one value wide", 4, narrow_knots},
            {"one knot, 65536, clear, opaque", 4, knots},
            {"axes of 1 to 2048, spacings 1:1000", 12, shape},
            {"steps of 1e-3 to 1e3 voxels", 3, step},
            {"pictures 1x1, 8192x1, 1x300", 3, picture},
            {"eyes in, on and far from the box", 26, eye},
            {"rays in at edges, corners, faces", 26, edge},
            {"fields of view of 1e-3 to 179", 3, field_of_view}};

/* ---- the ways: every classification with every filter; the other modes with every filter ---- */

/* OpenGL draws one of GL_WAYS, every mode, classification and filter among them: compiling all took 42 of 95 s (AMD EPYC, Zen 3). */
enum { GL_WAYS = 3 };
enum { FILTERS = 4, MODES = 4, WAYS = FILTERS * (TC_CLASSIFICATION_COUNT + MODES) + 1 };

static void take_way(test_case *c, int way) {
  static const tc_mode modes[MODES] = {TC_MODE_MIP, TC_MODE_MINIP, TC_MODE_AVERAGE, TC_MODE_MPR};
  int look = way / FILTERS, filter = way % FILTERS;
  tc_scene *s = &c->scene;
  s->filter = filter < TC_FILTER_COUNT ? (tc_filter)filter : TC_FILTER_CUBIC;
  s->sampling.prefilter = filter == TC_FILTER_COUNT;
  if (way == WAYS - 1) s->mode = TC_MODE_ISOSURFACE;
  else if (look < TC_CLASSIFICATION_COUNT) s->classification = (tc_classification)look;
  else s->mode = modes[look - TC_CLASSIFICATION_COUNT];
  /* Half of the ways, of each filter and each classification some. */
  if ((look + filter) % 2) s->sampling.termination = pow(10, -1 - look % 3);
  if (way != 0 && !c->subtables) c->table_size = 64; /* the plan's own choice is what the first way is for */
}

enum { MOST_CASES = 26 };
static size_t shown[G_N_ELEMENTS(rows)][MOST_CASES]; /* pixels that show something, of all ways of dvr */

/* Without extinction, and with the box behind the eye. */
static bool shows_nothing(const struct row *row, int i) {
  return (row->bend == knots && i == 1) || (row->bend == edge && i == 25);
}

static void judge_row(const struct row *row, int way, size_t judged[RENDERERS + 1]) {
  test_tally before = test_judged;
  for (int i = way % stride(); i < row->count; i += stride()) {
    test_case c = plain_case((uint64_t)i, TC_F32);
    char *refusal = NULL;
    row->bend(&c, i);
    take_way(&c, way);
    if (!test_case_fit(&c, &refusal)) fail_msg("%s, %d, way %d is refused: %s", row->name, i, way, refusal);
    size_t was = test_judged.shown;
    bool sane = test_judge(&c, way % GL_WAYS && stride() > 1 ? TEST_ON_ALL & ~(1u << GL) : TEST_ON_ALL);
    if (c.scene.mode == TC_MODE_DVR) shown[row - rows][i] += test_judged.shown - was;
    if (sane) continue;
    test_case_print(&c);
    fail_msg("%s, %d, way %d: %s", row->name, i, way, test_judged_why);
  }
  for (int r = 0; r < RENDERERS; r++) judged[r] += test_judged.cases[r] - before.cases[r];
  judged[RENDERERS] += test_judged.referenced - before.referenced;
}

/* Way by way, so that shader programs are compiled once. */
TEST(every_way) {
  memset(&test_judged, 0, sizeof test_judged);
  size_t judged[G_N_ELEMENTS(rows)][RENDERERS + 1] = {{0}};
  for (int way = 0; way < WAYS; way++)
    for (size_t i = 0; i < G_N_ELEMENTS(rows); i++) judge_row(&rows[i], way, judged[i]);
  for (size_t i = 0; i < G_N_ELEMENTS(rows); i++) {
    printf("  %-35s %2d cases, %d ways: reference %zu", rows[i].name, rows[i].count, WAYS, judged[i][RENDERERS]);
    EACH_RENDERER(r) printf(", %s %zu", test_names[r], judged[i][r]);
    printf("\n");
    EACH_RENDERER(r) assert_true(stride() > 1 || judged[i][r] == (size_t)rows[i].count * WAYS);
    for (int k = 0; k < rows[i].count; k++)
      if (!SANITIZED && (shown[i][k] > 0) == shows_nothing(&rows[i], k)) fail_msg("%s, %d shows %zu", rows[i].name, k, shown[i][k]);
  }
  test_judge_print();
  EACH_RENDERER(i) assert_true((double)test_judged.ties[i] <= 0.01 * (double)test_judged.compared[i]);
}

/* The same bends of random scenes: shaded, labelled, clipped, several rays a pixel, turned grids. TC_RANDOM_SCENES and
 * TC_RANDOM_SEED are those of test_stability, of which this draws one in twenty. */
TEST(bent_random_scenes) {
  enum { SCENES = 20, ONE_IN = 20, WITH_GL = 30 }; /* of GL the compiling takes the time */
  const char *count = getenv("TC_RANDOM_SCENES"), *only = getenv("TC_RANDOM_SEED");
  uint64_t n = count ? strtoull(count, NULL, 10) / ONE_IN : only ? 1 : SCENES,
           first = only ? strtoull(only, NULL, 10) : 1;
  memset(&test_judged, 0, sizeof test_judged);
  for (uint64_t seed = first; seed < first + n; seed++) {
    uint64_t draw = seed;
    const struct row *row = &rows[(size_t)(test_random(&draw) * G_N_ELEMENTS(rows))];
    int i = (int)(test_random(&draw) * row->count);
    test_case c = test_case_random(seed);
    char *refusal = NULL;
    if (c.type != TC_F32) c.lo = 0, c.hi = 100;
    if (row->bend == span || row->bend == pattern) c.type = TC_F32;
    row->bend(&c, i);
    if (!test_case_fit(&c, &refusal))
      fail_msg("%s, %d of seed %zu is refused: %s", row->name, i, (size_t)seed, refusal);
    if (test_judge(&c, seed - first < WITH_GL ? TEST_ON_ALL : TEST_ON_ALL & ~(1u << GL))) continue;
    test_case_print(&c);
    fail_msg("%s, %d of seed %zu (TC_RANDOM_SEED repeats it): %s", row->name, i, (size_t)seed, test_judged_why);
  }
  test_judge_print();
  assert_true(n < 100 || test_judged.shown > test_judged.pixels / 20);
}

/* ---- the longer a ray, the less light comes through ---- */

/* Rays along y, cut by a plane at each of their samples: what is summed up to there is the sum up to the one before and
 * a segment more. */
TEST(opacity_grows) {
  enum { SIDE = 8, CUTS = 8 };
  unsigned seed = 7;
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {SIDE, SIDE, SIDE}, .type = TC_F32}, test_noise, &seed);
  const tc_knot knots[] = {{.value = 0.3, .amount = 0}, {.value = 0.3, .color = {1, 1, 1}, .amount = 0.02},
                           {.value = 0.8, .color = {1, 0.5, 0}, .amount = 0.3}, {.value = 0.9, .amount = 1e4}};
  double worst = 0, end[2], lo[3], hi[3];
  tc_volume_index_box(volume, lo, hi);
  for (int way = 0; way < 2 * FILTERS * TC_CLASSIFICATION_COUNT; way += STRIDE(3)) {
    if (way % 2 && way / 2 % FILTERS != TC_FILTER_LINEAR) continue; /* back to front, one filter is enough */
    test_case c = {0};
    tc_scene *s = &c.scene;
    test_scene(s, 9, 7);
    take_way(&c, way / 2);
    s->sampling.termination = 0;
    s->order = way % 2 ? TC_BACK_TO_FRONT : TC_FRONT_TO_BACK;
    s->sampling.step = 0.5;
    test_scene_knots(s, TC_KNOT_EXTINCTION, knots, G_N_ELEMENTS(knots));
    test_scene_look(s, TC_ORTHOGRAPHIC, (double[3]){3.5, -20, 3.5}, (double[3]){3.5, 3.5, 3.5}, 6);
    s->clip.n_planes = 1;
    s->clip.planes[0][1] = -1;
    EACH_RENDERER(r) {
      float before[9 * 7] = {0};
      for (int cut = 1; cut <= CUTS; cut++) {
        s->clip.planes[0][3] = lo[1] + 0.5 * cut;
        const tc_render_request request = {.want_linear = true, .table_size = c.table_size};
        const float *p = test_draw(r, volume, s, &request, NULL)->linear;
        double sum = 0;
        for (int i = 0; i < 9 * 7; i++) {
          worst = fmax(worst, before[i] - p[4 * i + 3]);
          before[i] = p[4 * i + 3];
          sum += before[i];
        }
        if (cut == 1 || cut == CUTS) end[cut > 1] = sum;
      }
      if (!(worst <= 2e-6)) fail_msg("%s, way %d: opacity falls by %g", test_names[r], way, worst);
      if (!(end[1] > end[0] + 5)) fail_msg("%s, way %d: opacity %g, then %g", test_names[r], way, end[0], end[1]);
    }
    tc_scene_clear(s);
  }
  printf("  opacity falls by %.1e at most\n", worst);
}

/* ---- neighbours one last bit apart within a wide range ---- */

static double last_bits(double x, double y, double z, const void *unused) {
  if (x == 0) return y < 4 ? 0 : 65536; /* out of view */
  double steps = fmod(x + y + z, 4);
  return 40000 + steps * 0x1p-8; /* 40000 has bits of 2^-8 */
}

TEST(one_last_bit_apart) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {16, 8, 8}, .type = TC_F32}, last_bits, NULL);
  const tc_knot knots[] = {{.value = 0, .color = {0, 0.1, 1}, .amount = 0.02},
                           {.value = 65536, .color = {1, 0.6, 0}, .amount = 0.3}};
  double worst[TC_CLASSIFICATION_COUNT] = {0};
  for (int way = 0; way < TC_CLASSIFICATION_COUNT * TC_FILTER_COUNT; way++) {
    g_auto(tc_scene) s;
    test_scene(&s, 5, 5);
    test_scene_knots(&s, TC_KNOT_EXTINCTION, knots, 2);
    test_scene_look(&s, TC_ORTHOGRAPHIC, (double[3]){9, -20, 3.4}, (double[3]){9.3, 4, 3.6}, 4);
    s.filter = (tc_filter)(way % TC_FILTER_COUNT);
    s.classification = (tc_classification)(way / TC_FILTER_COUNT);
    s.sampling.step = 0.01;
    g_autofree float *want = test_reference(volume, &s, 0);
    EACH_RENDERER(r) {
      const float *p = test_draw(r, volume, &s, NULL, NULL)->linear;
      double off = 0;
      for (int i = 0; i < 4 * 25; i++) off = fmax(off, fabs(p[i] - want[i]));
      worst[s.classification] = fmax(worst[s.classification], off);
    }
    assert_true(want[3] > 0.5);
  }
  for (int i = 0; i < TC_CLASSIFICATION_COUNT; i++) { /* linearized: half an opacity's square of each segment */
    printf("  %-14s %.1e\n", tc_classification_names[i], worst[i]);
    assert_true(worst[i] <= (i == TC_LINEARIZED ? 5e-4 : 1e-5));
  }
}

/* ---- what has no meaning is refused, and the member is named ---- */

static void refused(const char *pointer, const tc_volume *volume, const tc_scene *scene) {
  EACH_RENDERER(i) {
    GError *error = NULL;
    if (tc_render(test_renderers[i], (tc_volume *)volume, scene, NULL, &test_frames[i], &error))
      fail_msg("%s: %s is taken", test_names[i], pointer);
    const char *named = tc_error_pointer(error) ? tc_error_pointer(error) : "nothing";
    if (strcmp(named, pointer) || (error->code != TC_ERROR_INVALID && error->code != TC_ERROR_LIMIT))
      fail_msg("%s: %s expected, got %d %s: %s", test_names[i], pointer, error->code, named, error->message);
    g_clear_error(&error);
  }
}

TEST(meaningless) {
  static const double bad[] = {NAN, INFINITY, -INFINITY};
  test_case c = plain_case(0, TC_U8);
  g_autoptr(tc_volume) volume = test_case_volume(&c);
  const tc_scene good = c.scene;
#define REFUSED(pointer, ...)                                                                                          \
  do {                                                                                                                 \
    tc_scene s = good;                                                                                                 \
    __VA_ARGS__;                                                                                                       \
    refused(pointer, volume, &s);                                                                                      \
  } while (0)
  for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
    REFUSED("/camera/position", s.camera.position[1] = bad[i]);
    REFUSED("/camera/target", s.camera.target[2] = bad[i]);
    REFUSED("/camera/up", s.camera.up[0] = bad[i]);
    REFUSED("/camera/fovY", s.camera.fov_y_deg = bad[i]);
    REFUSED("/camera/height", s.camera.projection = TC_ORTHOGRAPHIC; s.camera.height_mm = bad[i]);
    REFUSED("/sampling/step", s.sampling.step = bad[i]);
    REFUSED("/sampling/termination", s.sampling.termination = bad[i]);
    REFUSED("/window/width", s.mode = TC_MODE_MIP; s.window.width = bad[i]);
    REFUSED("/window/center", s.mode = TC_MODE_MPR; s.window.center = bad[i]);
    REFUSED("/mpr/zoom", s.mode = TC_MODE_MPR; s.mpr.zoom = bad[i]);
    REFUSED("/clip/box", s.clip.has_box = true; s.clip.box[0][1] = bad[i]);
    REFUSED("/clip/planes/0", s.clip.n_planes = 1; s.clip.planes[0][0] = 1; s.clip.planes[0][3] = bad[i]);
    REFUSED("/shading/light", s.shading.model = TC_SHADING_LAMBERT; s.shading.light_at_camera = false;
            s.shading.light[0] = bad[i]);
    REFUSED("/shading/shininess", s.shading.model = TC_SHADING_BLINN_PHONG; s.shading.shininess = bad[i]);
    REFUSED("/transferFunction/unitDistance", s.transfer_function.kind = TC_KNOT_OPACITY;
            s.transfer_function.unit_distance_mm = bad[i]);
    tc_knot knots[2] = {{.value = 0, .amount = 1}, {.value = bad[i], .amount = 1}};
    REFUSED("/transferFunction/points/1", s.transfer_function.points = knots; s.transfer_function.count = 2);
    knots[1] = (tc_knot){.value = 1, .amount = bad[i]};
    REFUSED("/transferFunction/points/1", s.transfer_function.points = knots; s.transfer_function.count = 2);
  }
  REFUSED("/camera/up", memset(s.camera.up, 0, sizeof s.camera.up));
  REFUSED("/camera/target", memcpy(s.camera.target, s.camera.position, sizeof s.camera.target));
  REFUSED("/camera/fovY", s.camera.fov_y_deg = 180);
  REFUSED("/image/width", s.image.width = 0);
  REFUSED("/image/height", s.image.height = -1);
  REFUSED("/image/width", s.image.width = TC_MAX_IMAGE_SIDE + 1);
  REFUSED("/sampling/step", s.sampling.step = 0);
  REFUSED("/sampling/step", s.sampling.step = 1e-9);
  REFUSED("/transferFunction/points", s.transfer_function.count = 0);
  tc_knot unsorted[2] = {{.value = 1, .amount = 1}, {.value = 0, .amount = 1}};
  REFUSED("/transferFunction/points/1", s.transfer_function.points = unsorted; s.transfer_function.count = 2);
}

/* Numbers that are finite but whose squares, or distances, are not: either a sane picture or a refusal that names a
 * member. */
TEST(far_away) {
  static const double sizes[] = {1e7, 1e12, 1e30, 1e155, 1e300, 1e-300};
  test_case c = plain_case(0, TC_I16);
  g_autoptr(tc_volume) volume = test_case_volume(&c);
  const tc_scene good = c.scene;
  for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++)
    for (int member = 0; member < 7; member++)
      EACH_RENDERER(on) {
        tc_scene s = good;
        for (int k = 0; k < 3; k++) {
          if (member == 0) s.camera.position[k] *= sizes[i];
          if (member == 1) s.camera.target[k] *= sizes[i];
          if (member == 2) s.camera.up[k] *= sizes[i];
        }
        if (member == 3) s.camera.projection = TC_ORTHOGRAPHIC, s.camera.height_mm = sizes[i];
        if (member == 4) s.clip.n_planes = 1, s.clip.planes[0][0] = sizes[i], s.clip.planes[0][3] = 1;
        if (member == 5) s.camera.fov_y_deg = fmin(sizes[i], 179.999999);
        if (member == 6) s.mode = TC_MODE_MPR, s.mpr.zoom = sizes[i];
        GError *error = NULL;
        tc_render_request request = {.want_linear = true};
        if (!tc_render(test_renderers[on], volume, &s, &request, &test_frames[on], &error)) {
          if (!tc_error_pointer(error))
            fail_msg("%s, member %d at %g: %s", test_names[on], member, sizes[i], error->message);
          g_clear_error(&error);
        } else if (!test_judge_picture(on, &s, &test_frames[on])) {
          fail_msg("member %d at %g: %s", member, sizes[i], test_judged_why);
        }
      }
}

TESTS(test_judge_open, test_judge_close)
