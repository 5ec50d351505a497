/* Random scenes on every back end and instruction set against the invariants of every picture: no NaN, opacity within 0..1,
 * colour within opacity times the brightest knot, leaping changes no bit, threads change no bit, early termination changes
 * at most its threshold, both orders agree, back ends agree but for ties.
 *
 * TC_RANDOM_SCENES: how many (500); TC_RANDOM_SEED: only this one. A scene that fails is made smaller and printed. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "tests/support/cases.h"
#include "tests/support/grid.h"

enum { SCALAR, AVX2, AVX512, ONE_THREAD, GL, RENDERERS };
static const char *const names[RENDERERS] = {"scalar", "avx2", "avx512", "one thread", "gl"};
static tc_renderer *renderers[RENDERERS];
static char why[600];
static struct { size_t pixels, ties; } against[RENDERERS]; /* the scalar one's picture */
static size_t pixels_drawn, pixels_seen; /* a suite of empty pictures would judge nothing */

static int set_up(void **state) {
  for (int i = 0; i < RENDERERS; i++) {
    tc_renderer_options options = {.backend = i == GL ? TC_BACKEND_GL : TC_BACKEND_CPU, .threads = i == ONE_THREAD ? 1 : 2};
    if (i < ONE_THREAD) options.isa = names[i];
    GError *error = NULL;
    renderers[i] = tc_renderer_new(&options, &error);
    if (!renderers[i]) printf("  %s: not checked: %s\n", names[i], error->message);
    g_clear_error(&error);
  }
  return !renderers[SCALAR] || !renderers[ONE_THREAD];
}

static int tear_down(void **state) {
  for (int i = 0; i < RENDERERS; i++) tc_renderer_free(renderers[i]);
  return 0;
}

static bool broken(const char *format, ...) G_GNUC_PRINTF(1, 2);
static bool broken(const char *format, ...) {
  va_list args;
  va_start(args, format);
  vsnprintf(why, sizeof why, format, args);
  va_end(args);
  return false;
}

/* ---- one picture ---- */

static bool draw(int which, tc_volume *volume, const tc_scene *scene, tc_frame *frame) {
  GError *error = NULL;
  const tc_render_request request = {.want_linear = true};
  if (tc_render(renderers[which], volume, scene, &request, frame, NULL, &error)) return true;
  broken("%s: %d %s: %s", names[which], error->code, tc_error_pointer(error), error->message);
  bool refused = error->code == TC_ERROR_UNSUPPORTED || error->code == TC_ERROR_LIMIT;
  g_clear_error(&error);
  if (refused) why[0] = 0; /* a back end may do less than the plan allows, but says so */
  return false;
}

static size_t count_pixels(const tc_frame *f) { return (size_t)f->width * (size_t)f->height; }

/* Colour and opacity are two sums in single precision: of up to 1024 segments in a table entry, of n along the ray. */
static double slack_of(const tc_frame *f) {
  return 4e-6 + 2e-9 * (double)f->stats.samples / fmax(1, (double)f->stats.rays);
}

static bool check_picture(int which, const tc_scene *scene, const tc_frame *f) {
  double brightest[3] = {1, 1, 1}, slack = slack_of(f);
  if (scene->mode == TC_MODE_DVR && scene->shading.model == TC_SHADING_NONE)
    for (int c = 0; c < 3; c++) {
      brightest[c] = 0;
      for (size_t i = 0; i < scene->transfer_function.count; i++)
        brightest[c] = fmax(brightest[c], scene->transfer_function.points[i].color[c]);
    }
  for (size_t i = 0; i < count_pixels(f); i++) {
    const float *p = f->linear + 4 * i;
    bool sane = p[3] >= 0 && p[3] <= 1;
    for (int c = 0; c < 3; c++) sane = sane && p[c] >= 0 && p[c] <= p[3] * brightest[c] + slack;
    pixels_drawn++;
    pixels_seen += p[3] > 0;
    if (!sane) return broken("%s: pixel %zu is %.9g %.9g %.9g, opacity %.9g", names[which], i, p[0], p[1], p[2], p[3]);
  }
  return true;
}

/* Bits where most is 0, else absolute differences. */
static bool check_same(const char *what, int which, const tc_frame *a, const tc_frame *b, double most) {
  for (size_t i = 0; i < 4 * count_pixels(a); i++)
    if (most > 0 ? !(fabs((double)a->linear[i] - (double)b->linear[i]) <= most) : memcmp(&a->linear[i], &b->linear[i], 4) != 0)
      return broken("%s: %s: channel %zu of pixel %zu is %.9g, not %.9g", names[which], what, i % 4, i / 4, a->linear[i],
                    b->linear[i]);
  if (most == 0 && memcmp(a->rgba, b->rgba, 4 * count_pixels(a)) != 0)
    return broken("%s: %s: bytes differ though floats do not", names[which], what);
  return true;
}

static void count_ties(int which, const tc_frame *a, const tc_frame *b) {
  for (size_t i = 0; i < count_pixels(a); i++) {
    double off = 0;
    for (size_t c = 4 * i; c < 4 * i + 4; c++) off = fmax(off, fabs((double)a->linear[c] - (double)b->linear[c]));
    against[which].ties += off > 1.0 / 255;
  }
  against[which].pixels += count_pixels(a);
}

/* ---- one scene on one renderer ---- */

static tc_frame plain, other, scalar;

/* A picture of a scene that differs from *scene in what may not show, within `most`. */
static bool check_variant(const char *what, int which, int on, tc_volume *volume, const tc_scene *varied, double most) {
  if (!draw(on, volume, varied, &other)) return !why[0];
  return check_picture(on, varied, &other) && check_same(what, which, &plain, &other, most);
}

static bool check_renderer(int which, tc_volume *volume, const tc_scene *scene) {
  if (!draw(which, volume, scene, &plain)) return !why[0];
  if (!check_picture(which, scene, &plain)) return false;
  tc_scene varied = *scene;
  varied.skipping.mode = TC_SKIPPING_OFF;
  if (!check_variant("without leaps", which, which, volume, &varied, 0)) return false;
  varied = *scene;
  varied.sampling.termination = 0;
  if (scene->mode == TC_MODE_DVR && scene->sampling.termination > 0 &&
      !check_variant("not terminated", which, which, volume, &varied, scene->sampling.termination + slack_of(&plain)))
    return false;
  varied.order = scene->order == TC_FRONT_TO_BACK ? TC_BACK_TO_FRONT : TC_FRONT_TO_BACK;
  if (scene->mode == TC_MODE_DVR && scene->sampling.termination == 0 &&
      !check_variant("the other order", which, which, volume, &varied, slack_of(&plain)))
    return false;
  int best = renderers[AVX512] ? AVX512 : renderers[AVX2] ? AVX2 : SCALAR;
  return which != best || check_variant("on one thread", which, ONE_THREAD, volume, scene, 0);
}

/* Which renderers judge a seed: the scalar one is always drawn, for the others' pictures to be compared with. */
static unsigned judges(uint64_t seed) {
  unsigned mask = 1u << (seed % 3) | (seed % 8 == 0 ? 1u << GL : 0);
  return mask;
}

static unsigned mask_now;

static bool check_case(test_case *c) {
  test_case completed = *c;
  tc_volume *volume = test_case_volume(&completed);
  const tc_scene *scene = &completed.scene;
  why[0] = 0;
  bool ok = !(mask_now & 1) || check_renderer(SCALAR, volume, scene), compared = ok && draw(SCALAR, volume, scene, &scalar);
  for (int i = AVX2; ok && i < RENDERERS; i++) {
    if (i == ONE_THREAD || !renderers[i] || !(mask_now >> i & 1)) continue;
    ok = check_renderer(i, volume, scene);
    if (ok && compared && draw(i, volume, scene, &plain)) count_ties(i, &plain, &scalar);
  }
  tc_volume_unref(volume);
  return ok;
}

static bool still_fails(test_case *c) { return !check_case(c); }

static void judge(uint64_t seed, unsigned mask) {
  test_case c = test_case_random(seed);
  char *refusal = NULL;
  mask_now = mask;
  if (!test_case_fit(&c, &refusal)) fail_msg("seed %llu is refused: %s", (unsigned long long)seed, refusal);
  if (check_case(&c)) return;
  printf("  seed %llu fails: %s\n", (unsigned long long)seed, why);
  test_case small = test_case_shrink(&c, still_fails);
  check_case(&small);
  test_case_print(&small);
  fail_msg("seed %llu (TC_RANDOM_SEED repeats it), made smaller: %s", (unsigned long long)seed, why);
}

static void random_scenes(void **state) {
  const char *count = getenv("TC_RANDOM_SCENES"), *only = getenv("TC_RANDOM_SEED");
  uint64_t n = count ? strtoull(count, NULL, 10) : 500, first = only ? strtoull(only, NULL, 10) : 1;
  pixels_drawn = pixels_seen = 0;
  memset(against, 0, sizeof against);
  for (uint64_t seed = first; seed < first + (only ? 1 : n); seed++) judge(seed, only ? ~0u : judges(seed));
  for (int i = 1; i < RENDERERS; i++)
    if (against[i].pixels) {
      double share = (double)against[i].ties / (double)against[i].pixels;
      printf("  %s: %zu of %zu pixels differ from scalar by over 1/255 (%.3f %%)\n", names[i], against[i].ties,
             against[i].pixels, 100 * share);
      assert_true(share < 0.01 || only || n < 500);
    }
  printf("  %zu of %zu pixels show something\n", pixels_seen, pixels_drawn);
  assert_true(only || pixels_seen > pixels_drawn / 5);
}

/* ---- the cases that have names ---- */

/* The reference holds the invariants too, at a few pixels. */
static bool check_reference(test_case *c) {
  test_case completed = *c;
  tc_volume *volume = test_case_volume(&completed);
  int width = completed.scene.image.width, height = completed.scene.image.height;
  GError *error = NULL;
  tc_reference *reference = tc_reference_new(volume, &completed.scene, width, height, 1e-8, &error);
  bool ok = reference || error->code == TC_ERROR_UNSUPPORTED || broken("reference: %s", error->message);
  for (int i = 0; reference && ok && i < 3; i++) {
    double p[4];
    tc_reference_pixel(reference, (0.3 + 0.2 * i) * width, (0.7 - 0.2 * i) * height, p);
    for (int k = 0; ok && k < 3; k++)
      ok = (p[3] >= 0 && p[3] <= 1 && p[k] >= 0 && p[k] <= p[3] + 1e-7) || broken("reference: %g, opacity %g", p[k], p[3]);
  }
  g_clear_error(&error);
  tc_reference_free(reference);
  tc_volume_unref(volume);
  return ok;
}

/* A plain scene over noise, which each case then bends. */
static test_case plain_case(tc_voxel_type type) {
  test_case c = {.seed = 5, .dims = {9, 8, 7}, .type = type, .spacing = {1, 1, 1}, .slope = 1, .lo = 0, .hi = type == TC_F32 ? 1 : 100,
                 .side = {0.4, -1, 0.3}, .zoom = 1, .n_knots = 3};
  c.knots[0] = (tc_knot){0.2, {0.2, 0.4, 1}, 0};
  c.knots[1] = (tc_knot){0.5, {1, 0.8, 0.1}, 0.4};
  c.knots[2] = (tc_knot){0.9, {1, 1, 1}, 0.1};
  test_scene(&c.scene, 9, 7);
  g_free(c.scene.transfer_function.points);
  c.scene.transfer_function = (tc_transfer_function){.kind = TC_KNOT_EXTINCTION, .unit_distance_mm = 1};
  return c;
}

static void judge_named(const char *what, test_case c) {
  char *refusal = NULL;
  mask_now = ~0u;
  if (!test_case_fit(&c, &refusal)) fail_msg("%s is refused: %s", what, refusal);
  if (check_case(&c) && check_reference(&c)) return;
  test_case_print(&c);
  fail_msg("%s: %s", what, why);
}

static void spans_and_depths(void **state) {
  static const double spans[][4] = {{5, 5, 1, 0},          {1, 1.00000012, 1, 0},    {-0x1p31, 0x1p31, 1, 0}, {0, 1000, 1e-9, 0},
                                    {0, 1000, 1e9, -5e11}, {0, 1000, -2, 1000},      {1e5, 1e5 + 1, 1, 0},    {0, 0x1p-149, 1, 0},
                                    {-3e38, 3e38, 1, 0},   {0, 1e-30, 1e-9, 1e-20}};
  for (size_t i = 0; i < G_N_ELEMENTS(spans); i++) {
    test_case c = plain_case(TC_F32);
    c.lo = spans[i][0], c.hi = spans[i][1], c.slope = spans[i][2], c.intercept = spans[i][3];
    judge_named("a span of values", c);
  }
  for (double tau = 1e-12; tau < 2e12; tau *= 1e3)
    for (int type = TC_U8; type <= TC_F32; type += 2) {
      test_case c = plain_case((tc_voxel_type)type);
      for (int k = 0; k < 3; k++) c.knots[k].amount *= tau;
      c.pattern = TEST_LEVELS;
      judge_named("an optical depth", c);
    }
  for (int pattern = 0; pattern < TEST_PATTERN_COUNT; pattern++) {
    test_case c = plain_case(TC_F32);
    c.pattern = (test_pattern)pattern;
    judge_named("a pattern", c);
  }
}

static void shapes_and_steps(void **state) {
  static const int shapes[][3] = {{1, 1, 1}, {1, 9, 1}, {7, 1, 5}, {2, 2, 2}, {2048, 2, 1}, {1, 1, 2048}};
  static const int pictures[][2] = {{1, 1}, {8192, 1}, {1, 300}};
  for (size_t i = 0; i < G_N_ELEMENTS(shapes); i++)
    for (int thin = 0; thin < 2; thin++) {
      test_case c = plain_case((tc_voxel_type)(i % TC_VOXEL_TYPE_COUNT));
      memcpy(c.dims, shapes[i], sizeof c.dims);
      if (thin) c.spacing[i % 3] = 1000;
      judge_named("a shape", c);
    }
  for (size_t i = 0; i < G_N_ELEMENTS(pictures); i++) {
    test_case c = plain_case(TC_U16);
    c.scene.image.width = pictures[i][0], c.scene.image.height = pictures[i][1];
    judge_named("a size of the picture", c);
  }
  static const double steps[] = {1e-3, 17, 1e3};
  for (size_t i = 0; i < G_N_ELEMENTS(steps); i++) {
    test_case c = plain_case(TC_I16);
    c.scene.sampling.step = steps[i];
    judge_named("a step", c);
  }
}

static void transfer_functions(void **state) {
  for (int kind = 0; kind < TC_KNOT_KIND_COUNT; kind++)
    for (int which = 0; which < 5; which++) {
      test_case c = plain_case(which % 2 ? TC_U16 : TC_F32);
      if (c.type == TC_U16) c.hi = 65535;
      c.scene.transfer_function.kind = (tc_knot_kind)kind;
      for (size_t i = 0; i < TEST_MAX_KNOTS; i++) {
        /* clear; opaque; one knot; pairs at one value; a value wide, one after another */
        double at = which < 3 ? 0.5 : which == 3 ? 0.1 + 0.15 * (double)(i / 2) : 0.3 + (double)i / 65535;
        c.knots[i] = (tc_knot){at, {1, i % 2, 0.5}, which == 0 ? 0 : which == 1 ? 1 : i % 2 ? 0.9 : 0};
      }
      c.n_knots = which == 2 ? 1 : TEST_MAX_KNOTS;
      judge_named("a transfer function", c);
    }
}

static void eyes(void **state) {
  static const double insides[] = {0, 0.75, 0.9, 0.999999};
  static const double sides[][3] = {{0, -1, 0}, {0, 0, 1}, {1, 0, 0}, {1, 1, 0}, {1, 1, 1}};
  for (int projection = 0; projection < TC_PROJECTION_COUNT; projection++)
    for (size_t i = 0; i < G_N_ELEMENTS(insides); i++)
      for (size_t k = 0; k < G_N_ELEMENTS(sides); k++) {
        test_case c = plain_case((tc_voxel_type)(k % TC_VOXEL_TYPE_COUNT));
        c.projection = (tc_projection)projection;
        c.inside = insides[i];
        memcpy(c.side, sides[k], sizeof c.side);
        judge_named("an eye", c);
      }
}

/* ---- what has no meaning is refused, and the member is named ---- */

static void refused(const char *pointer, const tc_volume *volume, const tc_scene *scene) {
  for (int i = 0; i < RENDERERS; i++) {
    GError *error = NULL;
    if (!renderers[i]) continue;
    if (tc_render(renderers[i], (tc_volume *)volume, scene, NULL, &other, NULL, &error)) fail_msg("%s: %s is taken", names[i], pointer);
    const char *named = tc_error_pointer(error) ? tc_error_pointer(error) : "nothing";
    if (strcmp(named, pointer) || (error->code != TC_ERROR_INVALID && error->code != TC_ERROR_LIMIT))
      fail_msg("%s: %s wanted, got %d %s: %s", names[i], pointer, error->code, named, error->message);
    g_clear_error(&error);
  }
}

static void meaningless(void **state) {
  static const double bad[] = {NAN, INFINITY, -INFINITY};
  test_case c = plain_case(TC_U8);
  tc_volume *volume = test_case_volume(&c);
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
    REFUSED("/shading/light", s.shading.model = TC_SHADING_LAMBERT; s.shading.light_at_camera = false; s.shading.light[0] = bad[i]);
    REFUSED("/shading/shininess", s.shading.model = TC_SHADING_BLINN_PHONG; s.shading.shininess = bad[i]);
    REFUSED("/transferFunction/unitDistance", s.transfer_function.kind = TC_KNOT_OPACITY; s.transfer_function.unit_distance_mm = bad[i]);
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
  tc_volume_unref(volume);
}

/* Numbers that are finite but whose squares, or distances, are not: either a sane picture or a refusal that names a member. */
static void far_away(void **state) {
  static const double sizes[] = {1e7, 1e12, 1e30, 1e155, 1e300, 1e-300};
  test_case c = plain_case(TC_I16);
  tc_volume *volume = test_case_volume(&c);
  const tc_scene good = c.scene;
  for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++)
    for (int member = 0; member < 7; member++)
      for (int on = 0; on < RENDERERS; on++) {
        tc_scene s = good;
        if (!renderers[on]) continue;
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
        if (!tc_render(renderers[on], volume, &s, &request, &plain, NULL, &error)) {
          if (!tc_error_pointer(error)) fail_msg("%s, member %d at %g: %s", names[on], member, sizes[i], error->message);
          g_clear_error(&error);
        } else if (!check_picture(on, &s, &plain)) {
          fail_msg("member %d at %g: %s", member, sizes[i], why);
        }
      }
  tc_volume_unref(volume);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(meaningless),          cmocka_unit_test(far_away),
                                     cmocka_unit_test(spans_and_depths),     cmocka_unit_test(shapes_and_steps),
                                     cmocka_unit_test(transfer_functions),   cmocka_unit_test(eyes),
                                     cmocka_unit_test(random_scenes)};
  int failed = cmocka_run_group_tests_name("stability", tests, set_up, tear_down);
  tc_frame_finish(&plain);
  tc_frame_finish(&other);
  tc_frame_finish(&scalar);
  return failed;
}
