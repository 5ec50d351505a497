/* The cpu back end against closed forms and against the reference integrator: every instruction set this machine has.
 * Errors are of the linear frame (premultiplied colour, opacity) and are printed as numbers. */
#include "tests/support/test.h"
#include <float.h>

#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

static const tc_frame *render(int isa, tc_volume *volume, const tc_scene *scene) {
  return test_draw(isa, volume, scene, NULL, NULL);
}

static tc_scene knots_scene(int width, int height, tc_knot_kind kind, const tc_knot *knots, size_t count) {
  tc_scene scene;
  test_scene(&scene, width, height);
  test_scene_knots(&scene, kind, knots, count);
  return scene;
}

/* All instruction sets against `want`, and the wide ones against the scalar one. Bounds: of every channel. */
static double measure_against(const char *what, const float *want, tc_volume *volume, const tc_scene *scene, double rms,
                              double max) {
  size_t pixels = (size_t)scene->image.width * (size_t)scene->image.height;
  double first = 0;
  EACH_CPU(isa) {
    const tc_frame *frame = render(isa, volume, scene);
    test_difference d = test_compare(frame->linear, want, pixels);
    char line[128];
    snprintf(line, sizeof line, "%s, step %g, %s", what, scene->sampling.step, test_names[isa]);
    if (isa == 0) {
      test_print_difference(line, &d, scene->image.width);
      first = d.rms;
    }
    if (!d.finite || !(d.rms <= rms) || !(d.max <= max))
      fail_msg("%s: rms %g (bound %g), max %g (bound %g)", line, d.rms, rms, d.max, max);
    if (isa > 0) {
      d = test_compare(frame->linear, test_frames[0].linear, pixels);
      if (!(d.max <= 1e-4)) fail_msg("%s: differs from scalar by %g at pixel %zu", line, d.max, d.worst);
    }
  }
  return first;
}

static double measure(const char *what, tc_volume *volume, const tc_scene *scene, double rms, double max) {
  g_autofree float *want = test_reference(volume, scene, 0);
  double error = measure_against(what, want, volume, scene, rms, max);
  return error;
}

static tc_volume *slab(tc_voxel_type type, double a, double b) {
  return test_volume(&(test_grid){.dims = {12, 9, 9}, .type = type}, test_linear, (double[4]){b, 0, 0, a});
}

/* Along +x, all rays inside the slab. */
static void look_through(tc_scene *scene) {
  test_scene_look(scene, TC_ORTHOGRAPHIC, (double[3]){-20, 4, 4}, (double[3]){0, 4, 4}, 6);
}

/* A picture whose pixels are all the same. */
static float *plain(const tc_scene *scene, const double rgba[4]) {
  size_t n = (size_t)scene->image.width * (size_t)scene->image.height;
  float *image = calloc(n, 4 * sizeof *image);
  for (size_t i = 0; i < 4 * n; i++)
    image[i] = (float)rgba[i % 4];
  return image;
}

/* Errors allowed at the three steps; everywhere about 1.5 times what was measured, so that a loss of accuracy shows. */
static const double steps[] = {0.25, 1, 4};
typedef struct bounds {
  double rms[3], max[3];
} bounds;

/* ---- closed forms ---- */

TEST(homogeneous_slab) {
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
    g_autoptr(tc_volume) volume = slab((tc_voxel_type)type, 100, 0);
    for (size_t s = 0; s < G_N_ELEMENTS(steps); s++)
      for (double tau = 1e-12; tau < 2e12; tau *= type == TC_I16 ? 10 : 1e6) {
        tc_knot knot = {.value = 0, .color = {1, 0.25, 0}, .amount = tau};
        g_auto(tc_scene) scene = knots_scene(9, 6, TC_KNOT_EXTINCTION, &knot, 1);
        look_through(&scene);
        scene.sampling.step = steps[s];
        double alpha = -expm1(-11 * tau);
        g_autofree float *want = plain(&scene, (double[4]){alpha, 0.25 * alpha, 0, alpha});
        char what[64];
        snprintf(what, sizeof what, "homogeneous %s, tau*d %.0e", tc_voxel_type_name((tc_voxel_type)type), 11 * tau);
        measure_against(what, want, volume, &scene, 2e-6, 2e-6);
      }
  }
}

/* tau = k s / 11, s from 0 to 11 along the ray; colour constant in blue, proportional to s in green. */
TEST(linear_ramp) {
  g_autoptr(tc_volume) volume = slab(TC_F32, 0, 1);
  for (size_t s = 0; s < G_N_ELEMENTS(steps); s++)
    for (double k = 1e-4; k < 2; k *= 10) {
      tc_knot knots[] = {{.value = 0, .color = {0, 0, 0.5}, .amount = 0},
                         {.value = 11, .color = {0, 1, 0.5}, .amount = 11 * k}};
      g_auto(tc_scene) scene = knots_scene(9, 6, TC_KNOT_EXTINCTION, knots, 2);
      look_through(&scene);
      scene.sampling.step = steps[s];
      double depth = 60.5 * k, q = sqrt(depth), alpha = -expm1(-depth);
      double green = sqrt(2 / k) / 11 * (0.5 * sqrt(M_PI) * erf(q) - q * exp(-depth));
      g_autofree float *want = plain(&scene, (double[4]){0, green, 0.5 * alpha, alpha});
      char what[64];
      snprintf(what, sizeof what, "ramp of tau and colour, slope %.0e", k);
      /* a step of 4 leaves a last segment of 3/4: its colour is scaled like its opacity, which is not quite it */
      double bound = steps[s] == 4 ? 6e-4 : 6e-5;
      measure_against(what, want, volume, &scene, bound, bound);
    }
}

/* So many segments that each takes less than one part in 2^24 of the light: none may be lost. */
TEST(thin_media) {
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {2048, 3, 3}, .type = TC_U8}, test_constant, &(double){100});
  for (double tau = 1e-8; tau < 2e-2; tau *= 10)
    for (double step = 2; step > 0.01; step /= 8) {
      tc_knot knot = {.value = 0, .color = {1, 0.25, 0}, .amount = tau};
      g_auto(tc_scene) scene = knots_scene(4, 2, TC_KNOT_EXTINCTION, &knot, 1);
      test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){-20, 1, 1}, (double[3]){0, 1, 1}, 1);
      scene.sampling.step = step;
      double alpha = -expm1(-2047 * tau), samples = 2047 / step;
      g_autofree float *want = plain(&scene, (double[4]){alpha, 0.25 * alpha, 0, alpha});
      char what[64];
      snprintf(what, sizeof what, "thin medium, depth %.0e", 2047 * tau);
      measure_against(what, want, volume, &scene, 1, 1e-7 + 2e-9 * samples);
    }
}

/* ---- scenes ---- */

/* Values 0..1 in every voxel type. */
static tc_volume *waves(tc_voxel_type type, const double spacing[3], const double direction[9]) {
  static const double slope[] = {1.0 / 255, 1.0 / 127, 1.0 / 65535, 1.0 / 32767, 0};
  test_grid grid = {.dims = {32, 28, 24}, .type = type, .origin = {-15, 20, 7}, .slope = slope[type]};
  if (spacing) memcpy(grid.spacing, spacing, sizeof grid.spacing);
  if (direction) memcpy(grid.direction, direction, sizeof grid.direction);
  return test_volume(&grid, test_waves, &(double){20});
}

TEST(voxel_types) {
  static const bounds allowed = {{1.1e-4, 6.5e-4, 9.5e-3}, {1.9e-3, 4.4e-3, 7e-2}};
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
    g_autoptr(tc_volume) volume = waves((tc_voxel_type)type, NULL, NULL);
    g_auto(tc_scene) scene = knots_scene(40, 32, TC_KNOT_EXTINCTION, test_soft, G_N_ELEMENTS(test_soft));
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.8, -1.5, 0.6});
    g_autofree float *want = test_reference(volume, &scene, 0);
    for (size_t s = 0; s < G_N_ELEMENTS(steps); s++) {
      char what[64];
      snprintf(what, sizeof what, "waves %s", tc_voxel_type_name((tc_voxel_type)type));
      scene.sampling.step = steps[s];
      measure_against(what, want, volume, &scene, allowed.rms[s], allowed.max[s]);
    }
  }
}

static const double sheared[9] = {0.8, -0.6, 0, 0.6, 0.8, -0.25881904510252074, 0, 0, 0.9659258262890683};

TEST(views) {
  static const struct {
    const char *name;
    double spacing[3];
    bool shear;
  } grids[] = {{"isotropic", {1, 1, 1}, false},
               {"0.7x0.9x2.5", {0.7, 0.9, 2.5}, false},
               {"sheared 0.7x0.9x2.5", {0.7, 0.9, 2.5}, true}};
  static const double sides[][3] = {{0, -1, 0}, {1, 0.3, -0.4}, {-0.2, 0.1, 1}};
  for (size_t g = 0; g < G_N_ELEMENTS(grids); g++) {
    g_autoptr(tc_volume) volume = waves(TC_U16, grids[g].spacing, grids[g].shear ? sheared : NULL);
    for (int projection = 0; projection < TC_PROJECTION_COUNT; projection++)
      for (size_t i = 0; i < G_N_ELEMENTS(sides); i++) {
        g_auto(tc_scene) scene = knots_scene(31, 23, TC_KNOT_EXTINCTION, test_soft, G_N_ELEMENTS(test_soft));
        test_scene_frame(&scene, volume, (tc_projection)projection, sides[i]);
        char what[64];
        snprintf(what, sizeof what, "%s, %s, side %zu", grids[g].name, projection ? "orthographic" : "perspective", i);
        measure(what, volume, &scene, 9e-4, 6e-3);
      }
  }
}

/* Inside, on a face, on a corner, very far, very narrow, very wide. */
TEST(eyes) {
  g_autoptr(tc_volume) volume = waves(TC_I16, NULL, NULL);
  static const struct {
    const char *name;
    double index[3];
    double fov;
  } cases[] = {{"inside", {11, 9, 8}, 60},           {"on a face", {0, 14, 12}, 70},
               {"on a corner", {0, 0, 0}, 70},       {"inside, 179 degrees", {15, 14, 12}, 179},
               {"narrow", {-400, 20, 90}, 1e-3},     {"at 1e5 mm", {-1e5, 3e4, 1e4}, 0.02},
               {"at 1e7 mm", {-1e7, 3e6, 1e6}, 2e-4}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++)
    for (int projection = 0; projection < TC_PROJECTION_COUNT; projection++) {
      g_auto(tc_scene) scene = knots_scene(32, 24, TC_KNOT_EXTINCTION, test_soft, G_N_ELEMENTS(test_soft));
      double from[3], to[3];
      tc_volume_index_to_lps(volume, cases[i].index, from);
      tc_volume_index_to_lps(volume, (double[3]){16, 14.5, 12.5}, to);
      test_scene_look(&scene, (tc_projection)projection, from, to, projection == TC_PERSPECTIVE ? cases[i].fov : 30);
      char what[64];
      snprintf(what, sizeof what, "eye %s, %s", cases[i].name, projection ? "orthographic" : "perspective");
      measure(what, volume, &scene, 1.5e-3, 7e-3);
    }
}

static void demo(const char *name, const tc_knot *knots, size_t n_knots, const double side[3], const bounds *allowed) {
  GError *error = NULL;
  g_autoptr(tc_volume) volume = tc_volume_demo(name, &error);
  if (!volume) fail_msg("%s", error->message);
  g_auto(tc_scene) scene = knots_scene(48, 40, TC_KNOT_OPACITY, knots, n_knots);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, side);
  g_autofree float *want = test_reference(volume, &scene, 0);
  for (size_t s = 0; s < G_N_ELEMENTS(steps); s++) {
    scene.sampling.step = steps[s];
    measure_against(name, want, volume, &scene, allowed->rms[s], allowed->max[s]);
  }
}

TEST(demos) {
  static const tc_knot head[] = {{.value = -500, .color = {0.8, 0.5, 0.4}, .amount = 0},
                                 {.value = -100, .color = {0.9, 0.6, 0.5}, .amount = 0.02},
                                 {.value = 90, .color = {0.7, 0.2, 0.2}, .amount = 0.01},
                                 {.value = 400, .color = {1, 0.9, 0.7}, .amount = 0.3},
                                 {.value = 2000, .color = {1, 1, 1}, .amount = 0.9}};
  tc_volume *volume = tc_volume_demo("marschner-lobb", NULL);
  const tc_volume_stats *stats = tc_volume_statistics(volume);
  double lo = stats->min, width = stats->max - lo;
  tc_volume_unref(volume);
  const tc_knot lobes[] = {{.value = lo + 0.3 * width, .color = {0.1, 0.2, 1}, .amount = 0},
                           {.value = lo + 0.5 * width, .color = {1, 0.9, 0.2}, .amount = 0.4},
                           {.value = lo + 0.7 * width, .color = {1, 0.1, 0}, .amount = 0}};
  demo("marschner-lobb", lobes, 3, (double[3]){0.3, -1, 0.4}, &(bounds){{7e-4, 1.2e-2, 5.5e-2}, {8e-3, 0.12, 0.8}});
  demo("head", head, 5, (double[3]){0.5, -1, 0.4}, &(bounds){{1.6e-4, 2.2e-3, 1.6e-2}, {3.3e-3, 3.3e-2, 0.19}});
}

/* Step opacity on a ball: what a hard edge costs. */
TEST(ball) {
  static const bounds allowed = {{8e-5, 3.5e-4, 8e-3}, {1.8e-3, 4.2e-3, 9.5e-2}};
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {33, 33, 33}, .type = TC_F32}, test_radius2, (double[3]){16, 16, 16});
  for (int linear_light = 0; linear_light < 2; linear_light++) {
    tc_knot knots[] = {{.value = 121, .color = {1, 0.6, 0.1}, .amount = 0.15},
                       {.value = 121, .color = {1, 0.6, 0.1}, .amount = 0}};
    g_auto(tc_scene) scene = knots_scene(33, 27, TC_KNOT_EXTINCTION, knots, 2);
    scene.image.linear_light = linear_light;
    test_scene_frame(&scene, volume, TC_ORTHOGRAPHIC, (double[3]){0.3, -1, 0.2});
    for (size_t s = 0; s < G_N_ELEMENTS(steps); s++) {
      scene.sampling.step = steps[s];
      measure(linear_light ? "ball, linear light" : "ball", volume, &scene, allowed.rms[s], allowed.max[s]);
    }
  }
}

/* ---- order of convergence ---- */

/* Pre-integration treats the field as linear along a segment: its error is O(step^2) on a smooth scene. The field's
 * wavelength is 80 voxels, steps 8 .. 1 voxels; extinction and colour are linear in the value, so that the table's own
 * error (measured by the constant 1e-6 of the ramp test) stays an order below the finest step's. */
TEST(observed_order) {
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {64, 64, 64}, .type = TC_F32}, test_waves, &(double){80});
  tc_knot knots[] = {{.value = 0, .color = {0.2, 0.4, 1}, .amount = 0},
                     {.value = 1, .color = {1, 0.5, 0}, .amount = 0.08}};
  g_auto(tc_scene) scene = knots_scene(40, 40, TC_KNOT_EXTINCTION, knots, 2);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.5, -1, 0.3});
  scene.camera.fov_y_deg = 12;
  g_autofree float *want = test_reference(volume, &scene, 0);
  double error[4];
  for (int i = 0; i < 4; i++) {
    scene.sampling.step = 8 >> i;
    error[i] = measure_against("smooth", want, volume, &scene, 2e-3, 6e-3);
  }
  double order = log2(error[0] / error[3]) / 3;
  printf("  observed order of preintegrated: %.3f over three octaves (%.2f, %.2f, %.2f)\n", order,
         log2(error[0] / error[1]), log2(error[1] / error[2]), log2(error[2] / error[3]));
  assert_true(fabs(order - 2) <= 0.15);
}

/* ---- contracts ---- */

TEST(early_termination) {
  static const double thresholds[] = {0.001, 0.01, 0.1};
  g_autoptr(tc_volume) volume = waves(TC_U8, NULL, NULL);
  tc_knot knots[] = {{.value = 0.2, .color = {1, 1, 0.5}, .amount = 0},
                     {.value = 1, .color = {1, 0, 1}, .amount = 0.9}};
  g_auto(tc_scene) scene = knots_scene(40, 32, TC_KNOT_EXTINCTION, knots, 2);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.8, -1.5, 0.6});
  size_t pixels = 40 * 32;
  EACH_CPU(isa) {
    scene.sampling.termination = 0;
    const tc_frame *frame = render(isa, volume, &scene);
    uint64_t samples = frame->stats.samples;
    g_autofree float *whole = g_memdup2(frame->linear, pixels * 4 * sizeof(float));
    for (size_t i = 0; i < G_N_ELEMENTS(thresholds); i++) {
      scene.sampling.termination = thresholds[i];
      frame = render(isa, volume, &scene);
      test_difference d = test_compare(frame->linear, whole, pixels);
      printf("  %s: threshold %g changes a pixel by at most %.2e; %.0f %% of the samples\n", test_names[isa],
             thresholds[i], d.max, 100.0 * (double)frame->stats.samples / (double)samples);
      assert_true(d.max > 0 && d.max <= thresholds[i] + 1e-6);
      assert_true(frame->stats.samples < samples);
    }
  }
}

static double block(double x, double y, double z, const void *unused) {
  return x >= 4 && x <= 8 && y >= 4 && y <= 8 && z >= 4 && z <= 8 ? 200 : 0;
}

TEST(opaque_colour_is_exact) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {13, 13, 13}, .type = TC_U8}, block, NULL);
  for (int variant = 0; variant < 16; variant++) {
    tc_knot knots[] = {{.value = 0, .color = {1, 0, 0}, .amount = 0},
                       {.value = 100, .color = {1, 0, 0}, .amount = 0},
                       {.value = 100, .color = {1, 0, 0}, .amount = variant & 4 ? 1e6 : 1}};
    g_auto(tc_scene) scene = knots_scene(64, 64, variant & 4 ? TC_KNOT_EXTINCTION : TC_KNOT_OPACITY, knots, 3);
    scene.image.linear_light = variant & 1;
    scene.image.transparent = variant & 2;
    scene.image.background[2] = 1;
    scene.sampling.termination = variant & 8 ? 0.001 : 0;
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.2, -1, 0.1});
    EACH_CPU(isa) {
      const tc_frame *frame = render(isa, volume, &scene);
      for (int y = 30; y < 34; y++)
        for (int x = 30; x < 34; x++) {
          const uint8_t *p = frame->rgba + 4 * (64 * y + x);
          if (p[0] != 255 || p[1] != 0 || p[2] != 0 || p[3] != 255)
            fail_msg("%s, variant %d: pixel %d,%d is %d %d %d %d, not 255 0 0 255", test_names[isa], variant, x, y,
                     p[0], p[1], p[2], p[3]);
        }
      const uint8_t *corner = frame->rgba;
      assert_int_equal(corner[0], 0);
      assert_int_equal(corner[3], scene.image.transparent ? 0 : 255);
      if (!scene.image.transparent) assert_int_equal(corner[2], 255);
    }
  }
}

TEST(threads_make_no_difference) {
  static const int counts[] = {1, 2, 3, 5};
  g_autoptr(tc_volume) volume = waves(TC_U16, NULL, NULL);
  g_auto(tc_scene) scene = knots_scene(131, 97, TC_KNOT_EXTINCTION, test_soft, G_N_ELEMENTS(test_soft));
  scene.sampling.termination = 0.01;
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.8, -1.5, 0.6});
  size_t bytes = 131 * 97 * 4;
  EACH_CPU(isa) {
    g_autofree uint8_t *rgba = NULL;
    g_autofree float *linear = NULL;
    for (size_t i = 0; i < G_N_ELEMENTS(counts); i++) {
      g_auto(tc_frame) frame = {0};
      tc_renderer_options options = {.backend = TC_BACKEND_CPU, .threads = counts[i], .isa = test_names[isa]};
      g_autoptr(tc_renderer) renderer = tc_renderer_new(&options, NULL);
      assert_true(tc_render(renderer, volume, &scene, &(tc_render_request){.want_linear = true}, &frame, NULL));
      if (i == 0) {
        rgba = g_memdup2(frame.rgba, bytes);
        linear = g_memdup2(frame.linear, bytes * sizeof(float));
      }
      assert_memory_equal(frame.rgba, rgba, bytes);
      assert_memory_equal(frame.linear, linear, bytes * sizeof(float));
    }
  }
}

/* ---- stiff and extreme cases: invariants ---- */

/* Leaping over what is empty changes no bit of a picture. */
static void check_skipping(const char *what, int isa, tc_volume *volume, const tc_scene *scene, size_t pixels) {
  tc_scene plain_scene = *scene; /* shares the knots */
  plain_scene.skipping.mode = TC_SKIPPING_OFF;
  g_autofree float *leapt = g_memdup2(test_frames[isa].linear, pixels * 4 * sizeof(float));
  const float *all = render(isa, volume, &plain_scene)->linear;
  for (size_t i = 0; i < 4 * pixels; i++)
    if (memcmp(&leapt[i], &all[i], sizeof(float)))
      fail_msg("%s, %s: channel %zu of pixel %zu is %.9g with leaps, %.9g without", what, test_names[isa], i % 4, i / 4,
               (double)leapt[i], (double)all[i]);
}

/* No NaN leaves, opacity is within 0..1, colour is within opacity times the brightest knot; instruction sets agree
 * where `agree` says how well (0: not asked). */
static void check_invariants(const char *what, tc_volume *volume, const tc_scene *scene, double agree) {
  double brightest[3] = {0};
  const tc_transfer_function *tf = &scene->transfer_function;
  for (size_t i = 0; i < tf->count; i++)
    for (int c = 0; c < 3; c++)
      brightest[c] = fmax(brightest[c], tf->points[i].color[c]);
  size_t pixels = (size_t)scene->image.width * (size_t)scene->image.height;
  EACH_CPU(isa) {
    const tc_frame *frame = render(isa, volume, scene);
    /* Colour and opacity are two sums in single precision: of up to 1024 segments in a table entry, of n along the ray.
     */
    double samples = (double)frame->stats.samples / fmax(1, (double)frame->stats.rays), slack = 4e-6 + 2e-9 * samples;
    for (size_t i = 0; i < pixels; i++) {
      const float *p = frame->linear + 4 * i;
      bool sane = isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]) && p[3] >= 0 && p[3] <= 1;
      for (int c = 0; c < 3; c++)
        sane = sane && p[c] >= 0 && p[c] <= p[3] * brightest[c] + slack;
      if (!sane)
        fail_msg("%s, %s: pixel %zu of %dx%d is %.9g %.9g %.9g, opacity %.9g; colour may be at most %.9g %.9g %.9g",
                 what, test_names[isa], i, scene->image.width, scene->image.height, p[0], p[1], p[2], p[3],
                 p[3] * brightest[0], p[3] * brightest[1], p[3] * brightest[2]);
    }
    check_skipping(what, isa, volume, scene, pixels);
    if (isa > 0 && agree > 0) {
      test_difference d = test_compare(frame->linear, test_frames[0].linear, pixels);
      if (!(d.max <= agree))
        fail_msg("%s: %s differs from scalar by %g at pixel %zu", what, test_names[isa], d.max, d.worst);
    }
  }
}

TEST(not_finite_voxels) {
  static const float odd[] = {NAN, INFINITY, -INFINITY, FLT_MAX, -FLT_MAX, FLT_MIN, 0x1p-149f};
  for (int all = 0; all < 2; all++)
    for (size_t o = 0; o < G_N_ELEMENTS(odd); o++) {
      tc_volume_desc desc = {.dims = {9, 8, 7},
                             .type = TC_F32,
                             .spacing = {1, 1, 1},
                             .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                             .slope = 1};
      g_autoptr(tc_volume) volume = tc_volume_new(&desc, NULL);
      float *voxels = tc_volume_voxels(volume);
      for (int i = 0; i < 9 * 8 * 7; i++)
        voxels[i] = all || i % 5 == 0 ? odd[o] : (float)(i % 7);
      tc_volume_seal(volume);
      tc_knot knots[] = {{.value = 0, .color = {1, 0, 0}, .amount = 0}, {.value = 6, .color = {0, 1, 1}, .amount = 2}};
      g_auto(tc_scene) scene = knots_scene(17, 16, TC_KNOT_EXTINCTION, knots, 2);
      test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.8, -1.5, 0.6});
      char what[64];
      snprintf(what, sizeof what, "%s voxels of %g", all ? "all" : "some", (double)odd[o]);
      check_invariants(what, volume, &scene, 0);
    }
}

/* Value ranges of 0, of one unit in the last place, of 2^32; rescale slopes of both signs and sizes. */
TEST(ranges_and_slopes) {
  static const struct {
    const char *name;
    float a, b;
    double slope, intercept;
  } cases[] = {{"range 0", 5, 5, 1, 0},
               {"range 1 ulp", 1, 1.00000012f, 1, 0},
               {"range 2^32", -0x1p31f, 0x1p31f, 1, 0},
               {"range 1e30", -1e30f, 1e30f, 1, 0},
               {"range 1e-30", 0, 1e-30f, 1, 0},
               {"slope 1e-9", 0, 1000, 1e-9, 0},
               {"slope 1e9", 0, 1000, 1e9, -5e11},
               {"slope -2", 0, 1000, -2, 1000},
               {"far offset", 100000, 100001, 1, 0}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    double a = cases[i].slope * cases[i].a + cases[i].intercept, b = cases[i].slope * cases[i].b + cases[i].intercept;
    g_autoptr(tc_volume) volume = test_volume(
        &(test_grid){.dims = {12, 9, 9}, .type = TC_F32, .slope = cases[i].slope, .intercept = cases[i].intercept},
        test_linear, (double[4]){(b - a) / 11, 0, 0, a});
    double lo = fmin(a, b), hi = fmax(a, b);
    tc_knot knots[] = {{.value = lo, .color = {0, 1, 0}, .amount = 0.01},
                       {.value = lo + 0.5 * (hi - lo), .color = {1, 0, 1}, .amount = 0.3},
                       {.value = hi, .color = {1, 1, 1}, .amount = 0.1}};
    g_auto(tc_scene) scene = knots_scene(9, 6, TC_KNOT_EXTINCTION, knots, 3);
    look_through(&scene);
    check_invariants(cases[i].name, volume, &scene, 1e-4);
    measure(cases[i].name, volume, &scene, 1.5e-5, 1.7e-5);
  }
}

/* A peak one value wide in 16-bit data: seen, with the right strength, by every step. */
TEST(one_value_peak) {
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {12, 9, 9}, .type = TC_U16}, test_linear, (double[4]){5900, 0, 0, 100});
  for (double at = 20000; at < 20003; at += 0.7) {
    tc_knot knots[] = {{.value = at - 0.5, .color = {1, 1, 0}, .amount = 0},
                       {.value = at, .color = {1, 1, 0}, .amount = 5900},
                       {.value = at + 0.5, .color = {1, 1, 0}, .amount = 0}};
    g_auto(tc_scene) scene = knots_scene(9, 6, TC_KNOT_EXTINCTION, knots, 3);
    look_through(&scene); /* the field passes a unit in 1/5900 mm: optical depth 1/2 */
    for (size_t s = 0; s < G_N_ELEMENTS(steps); s++) {
      scene.sampling.step = steps[s];
      measure("peak one value wide", volume, &scene, 1e-4, 1.2e-4);
    }
  }
}

/* The same where the data's range is wide and the field slow: the peak is a small part of what lies between two nodes
 * of a table over the range. The ramp meets it at x = 5.37; two corner voxels, out of sight, make the range. */
static double ramp_in_wide_range(double x, double y, double z, const void *slope) {
  if (x + y + z == 0) return 0;
  return x + y + z == 27 ? 65535 : 20000 + *(const double *)slope * (x - 5.37);
}

TEST(peak_in_wide_range) {
  static const double slopes[] = {2, 10, 64, 900};
  static const double most[3][4] = {
      {5e-3, 6e-5, 3e-5, 1e-6}, {1e-4, 1.2e-5, 1e-5, 6e-6}, {1.2e-5, 1e-5, 2e-6, 1.5e-5}};
  for (int type = TC_U16; type <= TC_F32; type++)
    for (size_t i = 0; i < G_N_ELEMENTS(slopes); i++) {
      test_grid grid = {.dims = {12, 9, 9}, .type = (tc_voxel_type)type, .intercept = type == TC_I16 ? 32768 : 0};
      g_autoptr(tc_volume) volume = test_volume(&grid, ramp_in_wide_range, &slopes[i]);
      double tau = slopes[i]; /* optical depth 1/2 */
      tc_knot peak[] = {{.value = 19999.5, .color = {1, 1, 0}, .amount = 0},
                        {.value = 20000, .color = {1, 0, 0.5}, .amount = tau},
                        {.value = 20000.5, .color = {0, 1, 0}, .amount = 0}};
      tc_knot box[] = {{.value = 19999.5, .color = {1, 1, 0}, .amount = 0},
                       {.value = 19999.5, .color = {1, 1, 0}, .amount = 0.5 * tau},
                       {.value = 20000.5, .color = {0, 1, 0}, .amount = 0.5 * tau},
                       {.value = 20000.5, .color = {0, 1, 0}, .amount = 0}};
      for (int boxed = 0; boxed < 2; boxed++) {
        g_auto(tc_scene) scene = knots_scene(9, 6, TC_KNOT_EXTINCTION, boxed ? box : peak, boxed ? 4 : 3);
        look_through(&scene);
        for (size_t s = 0; s < G_N_ELEMENTS(steps); s++) {
          char what[96];
          snprintf(what, sizeof what, "%s %s in a range of 65536, %g a voxel", tc_voxel_type_name((tc_voxel_type)type),
                   boxed ? "box" : "peak", slopes[i]);
          scene.sampling.step = steps[s];
          measure(what, volume, &scene, most[s][i], most[s][i]);
        }
      }
    }
}

TEST(shapes_and_sizes) {
  static const int shapes[][3] = {{1, 1, 1}, {1, 9, 1}, {7, 1, 5}, {2, 2, 2}, {2048, 2, 1}, {1, 1, 2048}};
  static const int pictures[][2] = {{1, 1}, {8192, 1}, {1, 300}, {33, 17}};
  for (size_t s = 0; s < G_N_ELEMENTS(shapes); s++)
    for (size_t p = 0; p < G_N_ELEMENTS(pictures); p++) {
      unsigned seed = (unsigned)s;
      test_grid grid = {.dims = {shapes[s][0], shapes[s][1], shapes[s][2]},
                        .type = (tc_voxel_type)(s % TC_VOXEL_TYPE_COUNT),
                        .spacing = {1, s == 3 ? 1000 : 1, 1},
                        .slope = 0.01};
      g_autoptr(tc_volume) volume = test_volume(&grid, test_noise, &seed);
      g_auto(tc_scene) scene =
          knots_scene(pictures[p][0], pictures[p][1], TC_KNOT_EXTINCTION, test_soft, G_N_ELEMENTS(test_soft));
      test_scene_frame(&scene, volume, p & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE, (double[3]){0.21, -1, 0.1});
      char what[64];
      snprintf(what, sizeof what, "%dx%dx%d in %dx%d", shapes[s][0], shapes[s][1], shapes[s][2], pictures[p][0],
               pictures[p][1]);
      check_invariants(what, volume, &scene, 1e-4);
      if (p == 3) measure(what, volume, &scene, 2e-3, 4e-2);
    }
}

/* Many knots, steps of 1e-3 and 1e3 voxels, nothing to see, all opaque. */
TEST(odd_transfer_functions) {
  g_autoptr(tc_volume) volume = waves(TC_U16, NULL, NULL);
  g_autofree tc_knot *many = calloc(TC_MAX_KNOTS, sizeof *many);
  uint64_t seed = 11;
  for (size_t i = 0; i < TC_MAX_KNOTS; i++) {
    many[i].value = (double)(i / 2) / (TC_MAX_KNOTS / 2); /* every value twice: jumps everywhere */
    many[i].amount = test_random(&seed);
    for (int c = 0; c < 3; c++)
      many[i].color[c] = test_random(&seed);
  }
  tc_knot clear = {.value = 0.5, .color = {1, 1, 1}, .amount = 0},
          opaque = {.value = 0.5, .color = {1, 1, 1}, .amount = 1};
  static const double all_steps[] = {1e-3, 0.1, 1, 17, 1e3};
  for (size_t s = 0; s < G_N_ELEMENTS(all_steps); s++)
    for (int kind = 0; kind < TC_KNOT_KIND_COUNT; kind++)
      for (int which = 0; which < 3; which++) {
        if (which == 0 && (s % 2 == 0 || kind == TC_KNOT_OPACITY)) continue; /* a table of so many takes seconds */
        const tc_knot *knots = which == 0 ? many : which == 1 ? &clear : &opaque;
        tc_scene scene = knots_scene(12, 7, (tc_knot_kind)kind, knots, which ? 1 : TC_MAX_KNOTS);
        scene.sampling.step = all_steps[s];
        test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.8, -1.5, 0.6});
        char what[64];
        snprintf(what, sizeof what, "%s, step %g, kind %d",
                 which == 0   ? "65536 knots"
                 : which == 1 ? "clear"
                              : "opaque",
                 all_steps[s], kind);
        check_invariants(what, volume, &scene, 1e-3);
        if (which == 1)
          for (int i = 0; i < 4 * 12 * 7; i++)
            assert_true(test_frames[0].linear[i] == 0);
        tc_scene_clear(&scene);
      }
}

TESTS(test_renderers_open, test_renderers_close)
