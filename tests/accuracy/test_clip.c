/* Clip box and planes: exact at the face, alike on every back end, against the reference and closed forms. */
#include "tests/support/test.h"

#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

enum { SIDE = 40, PIXELS = SIDE * SIDE };

/* A homogeneous block cut at fractional places: opacity is 1 - exp(-tau * what is left), and nothing beside it. */
TEST(a_cut_block_is_exact) {
  const double value = 100, keep[2][3] = {{3.3, 2.71, 5.05}, {20.62, 17.9, 19.01}};
  test_grid g = {.dims = {33, 33, 33}, .type = TC_U8};
  g_autoptr(tc_volume) v = test_volume(&g, test_constant, &value);
  g_auto(tc_scene) s;
  test_scene(&s, SIDE, SIDE);
  const tc_knot knots[] = {{0, {1, 0.5, 0.25}, 0.05}};
  test_scene_knots(&s, TC_KNOT_EXTINCTION, knots, 1);
  s.sampling.step = 1.7;
  s.clip.has_box = true;
  memcpy(s.clip.box, keep, sizeof keep);
  for (int axis = 0; axis < 3; axis++) {
    double to[3] = {16, 16, 16}, from[3] = {16, 16, 16};
    from[axis] = -50;
    test_scene_look(&s, TC_ORTHOGRAPHIC, from, to, 32);
    double depth = keep[1][axis] - keep[0][axis], want = -expm1(-0.05 * depth);
    EACH_RENDERER(b) {
      tc_explanation plan;
      const tc_frame *f = test_draw(b, v, &s, NULL, &plan);
      int inside = 0;
      double worst = 0;
      for (int i = 0; i < PIXELS; i++) {
        double a = (double)f->linear[4 * i + 3];
        if (a == 0) continue;
        inside++;
        worst = fmax(worst, fabs(a - want));
        assert_true(fabs((double)f->linear[4 * i] - a) < 1e-6 && fabs((double)f->linear[4 * i + 1] - 0.5 * a) < 1e-6);
      }
      double area = 1;
      for (int k = 0; k < 3; k++) area *= k == axis ? 1 : keep[1][k] - keep[0][k];
      double pixels = area / ((32.0 / SIDE) * (32.0 / SIDE));
      printf("axis %d %-6s: opacity off by %.1e, %d pixels for %.1f\n", axis, test_names[b], worst, inside, pixels);
      /* an edge may take or leave half a row of 22 on each side */
      assert_true(worst < 2e-6 && fabs(inside - pixels) < 45);
      assert_true(plan.stages[TC_STAGE_CLIPPING].included && plan.key.clipping);
    }
  }
}

static void random_clip(tc_scene *s, const tc_volume *v, uint64_t *state) {
  double lo[3], hi[3], index[3], corner[2][3];
  tc_volume_index_box(v, lo, hi);
  s->clip.has_box = test_random(state) < 0.6;
  for (int c = 0; c < 2; c++) {
    for (int k = 0; k < 3; k++)
      index[k] = lo[k] + (hi[k] - lo[k]) * (c ? 0.5 + 0.6 * test_random(state) : 0.45 * test_random(state) - 0.1);
    tc_volume_index_to_lps(v, index, corner[c]);
  }
  for (int k = 0; k < 3; k++) {
    s->clip.box[0][k] = fmin(corner[0][k], corner[1][k]);
    s->clip.box[1][k] = fmax(corner[0][k], corner[1][k]);
  }
  s->clip.n_planes = (int)(4 * test_random(state));
  for (int i = 0; i < s->clip.n_planes; i++) {
    double *p = s->clip.planes[i], through[3];
    for (int k = 0; k < 3; k++) {
      p[k] = (test_random(state) - 0.5) * 7;
      index[k] = lo[k] + (hi[k] - lo[k]) * (0.25 + 0.5 * test_random(state));
    }
    tc_volume_index_to_lps(v, index, through);
    p[3] = -(p[0] * through[0] + p[1] * through[1] + p[2] * through[2]);
  }
}

/* Random boxes and planes over oblique, anisotropic volumes: the step goes to the reference, leaping changes
 * nothing. */
TEST(random_cuts_agree_with_the_reference) {
  uint64_t seed = 31;
  double worst_rms[RENDERERS] = {0};
  int shown = 0;
  for (int trial = 0; trial < 24; trial++) {
    double wavelength = 9;
    test_grid g = {.dims = {24, 30, 19}, .type = (tc_voxel_type)(trial % 5), .spacing = {1, 0.7, 1.6}};
    if (trial % 5 != TC_F32) g.slope = trial % 5 < 2 ? 1.0 / 120 : 1.0 / 30000;
    const double tilted[9] = {0.8, -0.6, 0.1, 0.6, 0.8, 0, 0, 0, 1};
    if (trial % 3) memcpy(g.direction, tilted, sizeof tilted);
    g_autoptr(tc_volume) v = test_volume(&g, test_waves, &wavelength);
    g_auto(tc_scene) s;
    test_scene(&s, SIDE, SIDE);
    const tc_knot knots[] = {{0.35, {0.2, 0.4, 1}, 0}, {0.6, {1, 0.8, 0.3}, 0.2}, {1, {1, 0.3, 0.2}, 0.5}};
    test_scene_knots(&s, TC_KNOT_EXTINCTION, knots, 3);
    const double side[3] = {test_random(&seed) - 0.5, test_random(&seed) - 0.5, test_random(&seed) - 0.5};
    test_scene_frame(&s, v, trial % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
    random_clip(&s, v, &seed);
    s.sampling.step = 0.2;
    g_autofree float *truth = test_reference(v, &s, 0);
    for (int i = 0; i < PIXELS; i++)
      if (truth[4 * i + 3] > 0.01f) { shown++; break; }
    EACH_RENDERER(b) {
      g_autofree float *leapt = g_memdup2(test_draw(b, v, &s, NULL, NULL)->linear, PIXELS * 16);
      test_difference d = test_compare(leapt, truth, PIXELS);
      if (!d.finite || d.rms > 1.5e-3) fail_msg("%s: trial %d: rms %.2e max %.2e", test_names[b], trial, d.rms, d.max);
      worst_rms[b] = fmax(worst_rms[b], d.rms);
      s.skipping.mode = TC_SKIPPING_OFF;
      assert_memory_equal(leapt, test_draw(b, v, &s, NULL, NULL)->linear, PIXELS * 16);
      s.skipping.mode = TC_SKIPPING_AUTO;
    }
  }
  EACH_RENDERER(b) printf("%-6s: worst rms against the reference %.2e over 24 cuts\n", test_names[b], worst_rms[b]);
  assert_true(shown > 12);
}

/* Everything cut away, a cut along the view, a cut beyond the volume. */
TEST(corner_cases) {
  const double value = 200;
  test_grid g = {.dims = {9, 9, 1}, .type = TC_I16};
  g_autoptr(tc_volume) v = test_volume(&g, test_constant, &value);
  g_auto(tc_scene) s;
  test_scene(&s, SIDE, SIDE);
  const tc_knot knots[] = {{0, {1, 1, 1}, 0.3}};
  test_scene_knots(&s, TC_KNOT_EXTINCTION, knots, 1);
  test_scene_look(&s, TC_ORTHOGRAPHIC, (double[3]){4, 4, 30}, (double[3]){4, 4, 0}, 12);
  static const double planes[][4] = {{0, 0, 1, -100}, {0, 0, -1, 100}, {1, 0, 0, -4}, {0, 0, 1, 0}};
  /* Pixel centres are at (i + 0.5) * 0.3 - 6 mm: 26 of them within 4 mm of the middle. */
  const int count[] = {0, 26 * 26, 13 * 26, 26 * 26};
  const double depth[] = {0, 1, 1, 0.5};
  for (int c = 0; c < 4; c++)
    EACH_RENDERER(b) {
      s.clip.n_planes = 1;
      memcpy(s.clip.planes[0], planes[c], sizeof planes[c]);
      const tc_frame *f = test_draw(b, v, &s, NULL, NULL);
      int inside = 0;
      for (int i = 0; i < PIXELS; i++) {
        if (f->linear[4 * i + 3] == 0) continue;
        inside++;
        assert_true(fabs((double)f->linear[4 * i + 3] + expm1(-0.3 * depth[c])) < 2e-6);
      }
      assert_int_equal(inside, count[c]);
    }
  GError *error = NULL;
  tc_explanation plan;
  memset(s.clip.planes[0], 0, sizeof s.clip.planes[0]);
  assert_false(tc_explain(v, &s, 8, 8, &plan, &error));
  assert_string_equal(tc_error_pointer(error), "/clip/planes/0");
  g_clear_error(&error);
  s.clip.n_planes = 0;
  s.clip.has_box = true;
  s.clip.box[0][1] = 1;
  assert_false(tc_explain(v, &s, 8, 8, &plan, &error));
  assert_string_equal(tc_error_pointer(error), "/clip/box");
  g_clear_error(&error);
}

TESTS(test_renderers_open, test_renderers_close)
