/* Media so dense that single precision calls a segment opaque of which a ray sees but a little: rays that end inside of
 * one, and segments that end beside a narrow peak. Every instruction set of this machine and OpenGL against the
 * reference. */
#include "tests/support/test.h"

#include "renderer/classify/preintegration.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

static const double depths[] = {1, 3, 10, 12, 30, 100, 1e3, 1e5}; /* of a whole segment where it is densest */
static const double shares[] = {0.01, 0.03, 0.1, 0.5};

/* The largest error of opacity and of colour over all renderers, in one picture. */
static void measure(tc_volume *volume, const tc_scene *scene, double most[2]) {
  size_t pixels = (size_t)scene->image.width * (size_t)scene->image.height;
  g_autofree float *want = test_reference(volume, scene, 0);
  tc_explanation plan;
  EACH_RENDERER(i) {
    const float *got = test_draw(i, volume, scene, NULL, &plan)->linear;
    for (size_t k = 0; k < 4 * pixels; k++) {
      double off = fabs((double)got[k] - (double)want[k]);
      if (!(off <= 1)) fail_msg("%s: %g", test_names[i], (double)got[k]);
      most[k % 4 != 3] = fmax(most[k % 4 != 3], off);
    }
  }
}

typedef struct medium {
  const char *name;
  double low, high;      /* of the field, at the ray's two ends */
  double least;          /* extinction where the field is 0, of that where it is 1 */
  double from[3], to[3]; /* colour */
  double thin, stiff;    /* bounds of the colour's error below and above TC_STIFF_DEPTH */
} medium;

static tc_scene look_along_x(tc_knot *knots, size_t count) {
  tc_scene scene;
  test_scene(&scene, 4, 3);
  test_scene_knots(&scene, TC_KNOT_EXTINCTION, knots, count);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){-20, 4, 4}, (double[3]){0, 4, 4}, 6);
  return scene;
}

/* One segment, of which the volume holds a share. Opacity is right for any depth; colour where it is linear in depth,
 * and else within a fifth of its change along the segment. */
TEST(a_short_segment) {
  static const medium media[] = {
      {"slab", 1, 1, 0, {0.9, 0.5, 0}, {0.9, 0.5, 0}, 1e-4, 1e-5},
      {"ramp", 0, 1, 0, {0.9, 0.5, 0}, {0.9, 0.5, 0}, 1e-4, 1e-5},
      {"slab, colours", 0, 1, 1, {0, 0.2, 1}, {1, 0.8, 0}, 0.25, 1e-5},
      {"ramp, colours", 0, 1, 0, {0, 0.2, 1}, {1, 0.8, 0}, 0.25, 0.2},
  };
  for (size_t m = 0; m < G_N_ELEMENTS(media); m++) {
    const medium *it = &media[m];
    g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {12, 9, 9}, .type = TC_F32}, test_linear,
                                    (double[4]){(it->high - it->low) / 11, 0, 0, it->low});
    for (size_t s = 0; s < G_N_ELEMENTS(shares); s++) {
      double step = 11 / shares[s], most[2][2] = {{0}};
      for (size_t i = 0; i < G_N_ELEMENTS(depths); i++) {
        double depth = depths[i];
        tc_knot knots[2] = {{.value = 0, .amount = it->least * depth / step}, {.value = 1, .amount = depth / step}};
        memcpy(knots[0].color, it->from, sizeof it->from);
        memcpy(knots[1].color, it->to, sizeof it->to);
        g_auto(tc_scene) scene = look_along_x(knots, 2);
        scene.sampling.step = step;
        measure(volume, &scene, most[depth > TC_STIFF_DEPTH]);
      }
      printf("  %-14s %2.0f %% of a segment: opacity %.0e, stiff %.0e; colour %.0e, stiff %.0e\n", it->name,
             100 * shares[s], most[0][0], most[1][0], most[0][1], most[1][1]);
      if (!(most[0][0] <= 1e-4 && most[1][0] <= 1e-5 && most[0][1] <= it->thin && most[1][1] <= it->stiff))
        fail_msg("%s, %g of a segment: opacity off by %g, %g, colour by %g, %g", it->name, shares[s], most[0][0],
                 most[1][0], most[0][1], most[1][1]);
    }
  }
}

/* Two values a voxel, and a corner with both ends of the range: what the rays see is inside a subtable of the table. */
static double narrow(double x, double y, double z, const void *unused) {
  return y == 0 && z == 0 ? 65535 * (x > 5) : 30000 + 2 * x;
}

/* Rays that meet a wall only just before their end, after clear segments, in every way in which segments are short. */
TEST(a_wall_at_the_end) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {12, 9, 9}, .type = TC_U16}, narrow, NULL);
  for (int n = 0; n < 12; n += STRIDE(5)) {
    double most[2][2] = {{0}};
    for (size_t i = 0; i < G_N_ELEMENTS(depths); i++) {
      double depth = depths[i];
      tc_knot knots[] = {{.value = 30021.7, .color = {0.9, 0.5, 0}, .amount = 0},
                         {.value = 30021.85, .color = {0.9, 0.5, 0}, .amount = depth / 1.08},
                         {.value = 30022, .color = {0.9, 0.5, 0}, .amount = 0}};
      g_auto(tc_scene) scene = look_along_x(knots, 3);
      scene.sampling.step = n / 4 == 2 ? 0.54 : 1.08;
      scene.classification = n % 2 ? TC_PREINTEGRATED2 : TC_PREINTEGRATED;
      scene.order = n / 2 % 2 ? TC_BACK_TO_FRONT : TC_FRONT_TO_BACK;
      scene.sampling.jitter = n / 4 == 1;
      scene.sampling.rays_per_pixel = n / 4 == 2 ? 2 : 1;
      measure(volume, &scene, most[depth >= 100]);
    }
    printf("  %-14s %s, %s: opacity off by %.0e, from a depth of 100 on %.0e\n",
           n % 2 ? "preintegrated2" : "preintegrated", n / 2 % 2 ? "back to front" : "front to back",
           n / 4 == 0 ? "one ray" : n / 4 == 1 ? "jitter" : "two rays", most[0][0], most[1][0]);
    for (int k = 0; k < 2; k++)
      if (!(most[0][k] <= 0.03 && most[1][k] <= 1e-3)) fail_msg("%d: off by %g, %g", n, most[0][k], most[1][k]);
  }
}

/* A peak one of 65536 values wide: segments reach from beside it, inside its subtable, to far outside of it. */
static double across_the_range(double x, double y, double z, const void *bend) {
  return 65535 * (0.1 + 0.9 * (6 * y + 2 * x + z + *(const double *)bend * x * z) / 300);
}

static void see_a_peak(tc_volume *volume, tc_scene *scene, const char *what, const double most[2]) {
  enum { PIXELS = 40 * 30 };
  g_autofree float *want = test_reference(volume, scene, 1e-9);
  for (int way = 0; way < 2; way++)
    for (double step = 4; step >= 1.0 / 16; step /= 4) {
      scene->classification = way ? TC_PREINTEGRATED2 : TC_PREINTEGRATED;
      scene->sampling.step = step;
      EACH_RENDERER(i) {
        tc_explanation plan;
        const float *got = test_draw(i, volume, scene, NULL, &plan)->linear;
        double square = 0, rms = test_compare(got, want, PIXELS).rms, opacity;
        for (int k = 0; k < PIXELS; k++) square += pow((double)got[4 * k + 3] - (double)want[4 * k + 3], 2);
        opacity = sqrt(square / PIXELS);
        if (i == test_widest())
          printf("  %-18s %s step %-6g opacity rms %.0e, all %.1e\n", what, way ? "second" : "first ", step, opacity,
                 rms);
        assert_true(plan.subtables > 0);
        if (!(opacity <= most[0] && rms <= most[1]))
          fail_msg("%s, %s, way %d, step %g: opacity %g, all %g", what, test_names[i], way, step, opacity, rms);
      }
    }
}

TEST(a_peak_at_any_step) {
  static const double cool[3] = {0.2, 0.45, 0.95}, bases[] = {0.002, 0.1}, bends[] = {0, 0.03};
  static const double most[2][2] = {{1e-4, 1e-3}, {5e-3, 4e-3}}; /* where the field bends segments do not fit it */
  for (size_t n = 0; n < G_N_ELEMENTS(bases) * G_N_ELEMENTS(bends); n++) {
    double base = bases[n / 2], bend = bends[n % 2];
    g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {32, 32, 32}, .type = TC_U16}, across_the_range, &bend);
    tc_knot knots[] = {{.value = 39999, .amount = base},
                       {.value = 40000, .color = {1, 0.55, 0.2}, .amount = 1000},
                       {.value = 40001, .amount = base}};
    memcpy(knots[0].color, cool, sizeof cool);
    memcpy(knots[2].color, cool, sizeof cool);
    g_auto(tc_scene) scene;
    char what[32];
    snprintf(what, sizeof what, "base %g%s", base, bend > 0 ? ", bent" : "");
    test_scene(&scene, 40, 30);
    test_scene_knots(&scene, TC_KNOT_EXTINCTION, knots, 3);
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){-1, -2, -0.7});
    see_a_peak(volume, &scene, what, most[n % 2]);
  }
}

TESTS(test_renderers_open, test_renderers_close)
