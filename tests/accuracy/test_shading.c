/* Shading on every instruction set and on OpenGL, against closed forms and against the reference integrator. Errors are
 * of the linear frame (premultiplied colour, opacity) and are printed as numbers. */
#include "tests/support/test.h"

#include <fenv.h>

#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

enum { SIDE = 64, PIXELS = SIDE * SIDE };

static const float *render(int which, tc_volume *volume, const tc_scene *scene, tc_explanation *plan) {
  return test_draw(which, volume, scene, NULL, plan)->linear;
}

/* ---- scenes ---- */

static const tc_knot soft[] = {{.value = 0, .color = {0.1, 0.2, 1}, .amount = 0},
                               {.value = 0.4, .color = {0.3, 0.9, 0.4}, .amount = 0.05},
                               {.value = 1, .color = {1, 0.6, 0.2}, .amount = 0.4}};

static void shaded_scene(tc_scene *scene, const tc_volume *volume, tc_shading_model model, const tc_knot *knots,
                         size_t count) {
  test_scene(scene, SIDE, SIDE);
  test_scene_knots(scene, TC_KNOT_EXTINCTION, knots, count);
  if (volume) test_scene_frame(scene, volume, TC_PERSPECTIVE, (double[3]){1, -0.6, 0.4});
  scene->shading.model = model;
  scene->shading.ambient = 0.25;
  scene->shading.diffuse = 0.7;
  scene->shading.specular = 0.3;
  scene->shading.shininess = 20;
}

static void light_from(tc_scene *scene, double x, double y, double z) {
  scene->shading.light_at_camera = false;
  scene->shading.light[0] = x, scene->shading.light[1] = y, scene->shading.light[2] = z;
}

static tc_volume *waves(tc_voxel_type type, double slope) {
  /* integer voxels store 0..1 in steps of 1/100, so that coarse voxels are checked too */
  return test_volume(&(test_grid){.dims = {24, 20, 22}, .type = type, .slope = type == TC_F32 ? slope : slope / 100},
                     test_waves, &(double){14});
}

static void pixel_at(const float *image, double x, double y, double rgba[4]) {
  for (int c = 0; c < 4; c++) rgba[c] = (double)image[((int)y * SIDE + (int)x) * 4 + c];
}

/* ---- agreement ---- */

TEST(everyone_agrees) {
  double worst[RENDERERS] = {0}, sum[RENDERERS] = {0};
  size_t ties = 0, compared[RENDERERS] = {0}, all = 0;
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++)
    for (int model = TC_SHADING_LAMBERT; model < TC_SHADING_COUNT; model++)
      for (int bits = type % STRIDE(3); bits < 8; bits += STRIDE(3)) {
        g_autoptr(tc_volume) volume = waves((tc_voxel_type)type, 1);
        g_auto(tc_scene) scene;
        shaded_scene(&scene, volume, (tc_shading_model)model, soft, 3);
        if (bits & 1) light_from(&scene, 0.3, -1, 2);
        if (bits & 2) scene.camera.projection = TC_ORTHOGRAPHIC, scene.camera.height_mm = 30;
        if (bits & 4) scene.sampling.termination = 0.01;
        scene.shading.gradient = (tc_gradient)((bits + model) % TC_GRADIENT_COUNT);
        scene.image.linear_light = bits == 5;
        render(SCALAR, volume, &scene, NULL);
        EACH_RENDERER(i) {
          if (i == SCALAR || (i == GL && (type + model + bits) % 3 && !getenv("TC_LONG"))) continue; /* it compiles */
          const float *a = render(i, volume, &scene, NULL), *b = test_frames[SCALAR].linear;
          assert_true(test_compare(a, b, PIXELS).finite);
          for (size_t p = 0; p < PIXELS; p++) {
            const double d = test_pixel_off(a, b, p);
            compared[i]++;
            /* Gradients jump at cell faces, and normals edge-on to the view turn over: rounding decides. */
            if (d > 1.0 / 255) ties++;
            else worst[i] = fmax(worst[i], d), sum[i] += d * d;
          }
        }
      }
  EACH_RENDERER(i) {
    if (i == SCALAR) continue;
    all += compared[i];
    double rms = sqrt(sum[i] / (double)compared[i]);
    printf("  %s against scalar: max %.2e rms %.2e but for ties\n", test_names[i], worst[i], rms);
    assert_true(rms < 1e-4);
  }
  printf("  over 1/255: %zu of %zu pixels\n", ties, all);
  assert_true((double)ties <= 1e-3 * (double)all);
}

TEST(energy_is_bounded) {
  g_autoptr(tc_volume) volume = waves(TC_F32, 1);
  for (int model = TC_SHADING_LAMBERT; model < TC_SHADING_COUNT; model++) {
    g_auto(tc_scene) scene;
    shaded_scene(&scene, volume, (tc_shading_model)model, soft, 3);
    scene.shading.ambient = scene.shading.diffuse = scene.shading.specular = 1;
    scene.shading.shininess = model == TC_SHADING_GOOCH ? 0 : 2;
    EACH_RENDERER(i) {
      const float *c = render(i, volume, &scene, NULL);
      for (size_t p = 0; p < PIXELS; p++, c += 4)
        for (int k = 0; k < 3; k++)
          if (!(c[3] <= 1 && c[k] >= 0 && c[k] <= c[3] + 2e-6f))
            fail_msg("%s: pixel %zu: %g of %g", test_names[i], p, c[k], c[3]);
    }
  }
}

/* ---- the reference is the limit ---- */

TEST(converges) {
  g_autoptr(tc_volume) volume = waves(TC_F32, 1);
  for (int model = SANITIZED ? TC_SHADING_GOOCH : TC_SHADING_LAMBERT; model < TC_SHADING_COUNT; model++)
    for (int fixed = 0; fixed < 2 - SANITIZED; fixed++) {
      g_auto(tc_scene) scene;
      shaded_scene(&scene, volume, (tc_shading_model)model, soft, 3);
      if (fixed) light_from(&scene, 1, -1, 1);
      scene.shading.gradient = (tc_gradient)((model + 2 * fixed) % TC_GRADIENT_COUNT);
      g_autofree float *want = test_reference(volume, &scene, 1e-6);
      EACH_RENDERER(i) {
        double rms[3];
        for (int s = 0; s < 3; s++) {
          scene.sampling.step = 1 / pow(4, s);
          test_difference d = test_compare(render(i, volume, &scene, NULL), want, PIXELS);
          assert_true(d.finite);
          rms[s] = d.rms;
        }
        printf("  model %d, %s, %s: rms %.2e %.2e %.2e at steps 1 1/4 1/16\n", model,
               fixed ? "fixed light" : "head light", test_names[i], rms[0], rms[1], rms[2]);
        /* first order: a cell's gradients jump at its faces */
        assert_true(rms[1] < 0.4 * rms[0] && rms[2] < 0.4 * rms[1]);
        assert_true(rms[0] < 1.2e-2 && rms[2] < 8e-4);
      }
    }
}

/* ---- a ball ---- */

/* Distance to a centre, in mm, from index coordinates of a grid with the given axes. */
typedef struct ball { const test_grid *grid; double center[3]; } ball;

static double to_lps(const test_grid *g, const double index[3], int r) {
  double lps = g->origin[r];
  for (int k = 0; k < 3; k++) lps += g->direction[3 * r + k] * g->spacing[k] * index[k];
  return lps;
}

static double distance_field(double x, double y, double z, const void *context) {
  const ball *b = context;
  double d2 = 0;
  for (int r = 0; r < 3; r++) {
    double d = to_lps(b->grid, (double[3]){x, y, z}, r) - b->center[r];
    d2 += d * d;
  }
  return 40 - fmin(fmax(sqrt(d2), 10), 14); /* steep enough to be shaded in full */
}

/* Opaque where the distance to the centre is under 12. */
static const tc_knot hard[] = {{.value = 28, .color = {0.8, 0.8, 0.8}, .amount = 0},
                               {.value = 28, .color = {0.8, 0.8, 0.8}, .amount = 1000}};

static tc_volume *ball_on(test_grid *grid, const double center[3]) {
  ball b = {.grid = grid, .center = {center[0], center[1], center[2]}};
  return test_volume(grid, distance_field, &b);
}

/* Trilinear gradients are off by up to half a voxel over the radius: 48 voxels are enough for one part in a hundred. */
static const test_grid even = {.dims = {129, 129, 129}, .type = TC_F32, .spacing = {0.25, 0.25, 0.25},
                               .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};

static void look_at_ball(tc_scene *scene, const double center[3]) {
  test_scene_look(scene, TC_ORTHOGRAPHIC, (double[3]){center[0] + 60, center[1], center[2]}, center, 30);
}

/* The ball's colour at offsets (y, z) mm from the centre, seen along -x: 0.8 * (ambient + diffuse * n.l) + glint. */
static double lit_ball(const tc_scene *s, double y, double z, double l[3]) {
  double n[3] = {sqrt(144 - y * y - z * z) / 12, y / 12, z / 12}, h[3] = {l[0] + 1, l[1], l[2]}, nl = 0, nh = 0, hh = 0;
  for (int k = 0; k < 3; k++) nl += n[k] * l[k], nh += n[k] * h[k], hh += h[k] * h[k];
  double glint = s->shading.specular * pow(nh / sqrt(hh), s->shading.shininess);
  if (s->shading.model == TC_SHADING_LAMBERT || nl <= 0) glint = 0;
  return fmin(1, 0.8 * (s->shading.ambient + s->shading.diffuse * fmax(nl, 0)) + glint);
}

static void check_ball(const char *what, tc_volume *volume, const double center[3], tc_gradient gradient) {
  for (int model = SANITIZED ? TC_SHADING_BLINN_PHONG : TC_SHADING_LAMBERT; model <= TC_SHADING_BLINN_PHONG; model++)
    for (int fixed = SANITIZED; fixed < 2; fixed++) {
      g_auto(tc_scene) scene;
      shaded_scene(&scene, NULL, (tc_shading_model)model, hard, 2);
      look_at_ball(&scene, center);
      scene.shading.gradient = gradient;
      scene.sampling.step = 0.25;
      double l[3] = {fixed ? 0.6 : 1, fixed ? 0.64 : 0, fixed ? 0.48 : 0};
      if (fixed) light_from(&scene, 3 * l[0], 3 * l[1], 3 * l[2]);
      EACH_RENDERER(i) {
        const float *image = render(i, volume, &scene, NULL);
        double worst = 0, rgba[4];
        for (int p = 0; p < PIXELS; p++) {
          /* seen from +x with z up, y grows to the right */
          double y = (p % SIDE + 0.5 - SIDE / 2) * 30.0 / SIDE, z = -(p / SIDE + 0.5 - SIDE / 2) * 30.0 / SIDE;
          if (y * y + z * z > 100) continue;
          pixel_at(image, p % SIDE, p / SIDE, rgba);
          worst = fmax(worst, fabs(rgba[0] - lit_ball(&scene, y, z, l)));
        }
        printf("  %s, model %d, gradient %d, %s light, %s: max %.2e\n", what, model, gradient, fixed ? "fixed" : "head",
               test_names[i], worst);
        /* a highlight changes faster than its normal */
        assert_true(worst < (model == TC_SHADING_LAMBERT ? 1e-2 : 2e-2));
      }
    }
}

TEST(analytic_ball) {
  test_grid grid = even;
  const double center[3] = {16, 16, 16};
  g_autoptr(tc_volume) volume = ball_on(&grid, center);
  check_ball("ball", volume, center, TC_GRADIENT_CELL);
  tc_volume_unref(volume);
  grid.slope = -0.5; /* stored upside down */
  volume = ball_on(&grid, center);
  check_ball("ball, negative slope", volume, center, TC_GRADIENT_CENTRAL);
}

/* The same ball on grids with other spacings and axes: the same picture. */
TEST(spacing_and_shear) {
  const double center[3] = {16, 16, 16}, c = cos(0.3), s = sin(0.3);
  test_grid tall = even, sheared = even, turned = even;
  tall.dims[0] = 257, tall.dims[2] = 161;
  tall.spacing[0] = 0.125, tall.spacing[2] = 0.2;
  g_autoptr(tc_volume) volume = ball_on(&tall, center);
  for (int gradient = 0; gradient < TC_GRADIENT_COUNT; gradient += STRIDE(2))
    check_ball("spacing 0.125, 0.25, 0.2", volume, center, (tc_gradient)gradient);
  tc_volume_unref(volume);
  /* the z axis leans over by 0.3 rad, as a gantry tilt does */
  memcpy(sheared.direction, (double[9]){1, 0, 0, 0, 1, s, 0, 0, c}, sizeof sheared.direction);
  sheared.origin[1] = -s * 16;
  sheared.dims[2] = 141;
  volume = ball_on(&sheared, center);
  for (int gradient = 0; gradient < TC_GRADIENT_COUNT; gradient += STRIDE(2))
    check_ball("sheared", volume, center, (tc_gradient)gradient);
  tc_volume_unref(volume);
  memcpy(turned.direction, (double[9]){0, -1, 0, 0, 0, 1, 1, 0, 0}, sizeof turned.direction);
  turned.origin[0] = 32;
  volume = ball_on(&turned, center);
  check_ball("turned", volume, center, TC_GRADIENT_CUBIC);
}

/* On voxels of a twelfth of the radius a ball shows its cells, unless gradients are continuous; and what is shaded is
 * counted, nothing where shading is off. */
TEST(smooth_gradients_show_no_cells) {
  test_grid grid = {
      .dims = {33, 33, 33}, .type = TC_F32, .spacing = {1, 1, 1}, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  const double center[3] = {16, 16, 16};
  double light[3] = {1, 0, 0};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_radius2, center);
  const tc_knot inside[] = {{144, {0.8, 0.8, 0.8}, 1000}, {144, {0.8, 0.8, 0.8}, 0}};
  uint64_t counted[RENDERERS][TC_GRADIENT_COUNT] = {{0}};
  EACH_RENDERER(i) {
    double rms[TC_GRADIENT_COUNT];
    for (int gradient = 0; gradient < TC_GRADIENT_COUNT; gradient++) {
      g_auto(tc_scene) scene;
      shaded_scene(&scene, NULL, TC_SHADING_LAMBERT, inside, 2);
      look_at_ball(&scene, center);
      scene.sampling.step = 0.1;
      scene.shading.gradient = (tc_gradient)gradient;
      const float *image = render(i, volume, &scene, NULL);
      double sum = 0;
      int n = 0;
      for (int p = 0; p < PIXELS; p++) {
        double y = (p % SIDE + 0.5 - SIDE / 2) * 30.0 / SIDE, z = -(p / SIDE + 0.5 - SIDE / 2) * 30.0 / SIDE;
        if (y * y + z * z > 100) continue;
        double off = (double)image[4 * p] - lit_ball(&scene, y, z, light);
        sum += off * off, n++;
      }
      rms[gradient] = sqrt(sum / n);
      counted[i][gradient] = test_frames[i].stats.gradients;
      assert_true(test_frames[i].stats.gradients > 0 && test_frames[i].stats.gradients <= test_frames[i].stats.samples);
      scene.shading.model = TC_SHADING_NONE;
      render(i, volume, &scene, NULL);
      assert_int_equal(test_frames[i].stats.gradients, 0);
    }
    printf("  %s: rms %.1e of cells, %.1e of central differences, %.1e of the cubic\n", test_names[i], rms[0], rms[1],
           rms[2]);
    assert_true(rms[TC_GRADIENT_CENTRAL] < 0.5 * rms[TC_GRADIENT_CELL]);
    assert_true(rms[TC_GRADIENT_CUBIC] < 0.5 * rms[TC_GRADIENT_CELL]);
    for (int gradient = 0; gradient < TC_GRADIENT_COUNT; gradient++) {
      double share = (double)counted[i][gradient] / (double)counted[SCALAR][gradient];
      assert_true(fabs(share - 1) < 1e-2);
    }
  }
}

TEST(light_turns_the_bright_side) {
  test_grid grid = even;
  const double center[3] = {16, 16, 16};
  g_autoptr(tc_volume) volume = ball_on(&grid, center);
  for (int model = TC_SHADING_LAMBERT; model < TC_SHADING_COUNT; model++)
    for (int sign = -1; sign <= 1; sign += 2) {
      g_auto(tc_scene) scene;
      shaded_scene(&scene, NULL, (tc_shading_model)model, hard, 2);
      look_at_ball(&scene, center);
      light_from(&scene, 0.2, sign, 0);
      EACH_RENDERER(i) {
        const float *image = render(i, volume, &scene, NULL);
        double left[4], right[4];
        pixel_at(image, SIDE / 2 - 16, SIDE / 2, left);
        pixel_at(image, SIDE / 2 + 16, SIDE / 2, right);
        assert_true(sign * (right[0] - left[0]) > 0.2); /* y grows to the right */
      }
    }
}

/* ---- leaving out ---- */

TEST(leaping_changes_no_bit) {
  static const tc_knot sparse[] = {{.value = 0.7, .color = {0.1, 0.2, 1}, .amount = 0},
                                   {.value = 0.8, .color = {1, 0.9, 0.4}, .amount = 0.5}};
  g_autofree float *whole = calloc(PIXELS, 16);
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++)
    for (int model = TC_SHADING_LAMBERT; model < TC_SHADING_COUNT; model++)
      for (int bits = (type + model) % STRIDE(4); bits < 4; bits += STRIDE(4)) {
        test_grid grid = {.dims = {60, 50, 55}, .type = (tc_voxel_type)type, .slope = type == TC_F32 ? 1 : 0.01};
        g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &(double){40});
        g_auto(tc_scene) scene;
        shaded_scene(&scene, volume, (tc_shading_model)model, sparse, 2);
        scene.sampling.step = 0.7;
        scene.shading.gradient = (tc_gradient)((bits + type) % TC_GRADIENT_COUNT);
        if (bits & 1) light_from(&scene, 1, 2, -1);
        if (bits & 2) scene.sampling.termination = 0.02;
        EACH_RENDERER(i) {
          if (i == GL && (2 * type + bits) % 3 && !getenv("TC_LONG")) continue; /* it compiles */
          scene.skipping.mode = TC_SKIPPING_OFF;
          memcpy(whole, render(i, volume, &scene, NULL), PIXELS * 16);
          scene.skipping.mode = TC_SKIPPING_AUTO;
          const float *leapt = render(i, volume, &scene, NULL);
          assert_true(test_frames[i].stats.leaps > 0);
          if (memcmp(whole, leapt, PIXELS * 16))
            fail_msg("%s: model %d, type %d, case %d: leaping shows", test_names[i], model, type, bits);
        }
      }
}

/* A ramp over the value range with noise of +- grain on it. */
static double grainy(double x, double y, double z, const void *grain) {
  return x / 1023 + *(const double *)grain * (2 * test_noise(x, y, z, &(unsigned){7}) - 1);
}

/* The largest difference that light makes, under every light and gradient. */
static double light_shows(int which, tc_volume *volume, double *least) {
  g_autofree float *plain = g_malloc(PIXELS * 16);
  double most = 0;
  *least = INFINITY;
  for (int model = TC_SHADING_LAMBERT; model < TC_SHADING_COUNT; model++)
    for (int fixed = 0; fixed < 2; fixed++)
      for (int gradient = 0; gradient < TC_GRADIENT_COUNT; gradient++) {
        g_auto(tc_scene) scene;
        shaded_scene(&scene, volume, TC_SHADING_NONE, soft, 3);
        memcpy(plain, render(which, volume, &scene, NULL), PIXELS * 16);
        scene.shading.model = (tc_shading_model)model;
        scene.shading.gradient = (tc_gradient)gradient;
        if (fixed) light_from(&scene, 0, -1, 1);
        test_difference d = test_compare(render(which, volume, &scene, NULL), plain, PIXELS);
        assert_true(d.finite);
        most = fmax(most, d.max), *least = fmin(*least, d.max);
      }
  return most;
}

/* A field without slope, and one whose noise has less slope than the threshold, are as if unshaded; more noise is
 * not. */
TEST(flat_is_unshaded) {
  const double quiet = 1e-3, loud = 0.05;
  tc_volume *volumes[] = {test_volume(&(test_grid){.dims = {256, 9, 9}, .type = TC_F32}, test_constant, &(double){0.5}),
                          test_volume(&(test_grid){.dims = {1024, 9, 9}, .type = TC_F32}, grainy, &quiet),
                          test_volume(&(test_grid){.dims = {1024, 9, 9}, .type = TC_F32}, grainy, &loud)};
  for (int v = 0; v < 3; v++) {
    EACH_RENDERER(i) {
      double least, most = light_shows(i, volumes[v], &least);
      printf("  volume %d, %s: light shows by %.1e to %.1e\n", v, test_names[i], least, most);
      assert_true(v == 2 ? least > 1e-3 : most <= 2e-7);
    }
    tc_volume_unref(volumes[v]);
  }
}

/* The order that segments are met in does not matter to their light. */
TEST(back_to_front_is_lit_alike) {
  g_autoptr(tc_volume) volume = waves(TC_U16, 1);
  for (int gradient = 0; gradient < TC_GRADIENT_COUNT; gradient++) {
    g_auto(tc_scene) scene;
    shaded_scene(&scene, volume, TC_SHADING_BLINN_PHONG, soft, 3);
    scene.shading.gradient = (tc_gradient)gradient;
    EACH_CPU(i) {
      scene.order = TC_FRONT_TO_BACK;
      g_autofree float *front = g_memdup2(render(i, volume, &scene, NULL), PIXELS * 16);
      uint64_t counted = test_frames[i].stats.gradients;
      scene.order = TC_BACK_TO_FRONT;
      test_difference d = test_compare(render(i, volume, &scene, NULL), front, PIXELS);
      assert_true(d.finite && d.max < 1e-5);
      assert_true(counted > 0 && test_frames[i].stats.gradients == counted);
    }
  }
}

/* The cubic filter is lit by its own derivative, whatever gradient is asked for; with coefficients by that of what they
 * make. */
TEST(cubic_filter_has_its_own) {
  g_autoptr(tc_volume) volume = waves(TC_U16, 1);
  for (int prefilter = SANITIZED; prefilter < 2; prefilter++) {
    g_auto(tc_scene) scene;
    tc_explanation plan;
    shaded_scene(&scene, volume, TC_SHADING_BLINN_PHONG, soft, 3);
    scene.filter = TC_FILTER_CUBIC;
    scene.sampling.prefilter = prefilter;
    scene.sampling.step = 0.25;
    g_autofree float *want = test_reference(volume, &scene, 1e-5);
    EACH_RENDERER(i) {
      test_difference d = test_compare(render(i, volume, &scene, &plan), want, PIXELS);
      assert_int_equal(plan.key.gradient, TC_GRADIENT_CUBIC);
      printf("  %s, prefilter %d: rms %.1e\n", test_names[i], prefilter, d.rms);
      assert_true(d.finite && d.rms < 5e-4);
    }
  }
}

TEST(plan_says_what_is_in) {
  g_autoptr(tc_volume) volume = waves(TC_U16, 1);
  tc_explanation plan;
  for (int model = TC_SHADING_NONE; model < TC_SHADING_COUNT; model++) {
    g_auto(tc_scene) scene;
    shaded_scene(&scene, volume, (tc_shading_model)model, soft, 3);
    scene.shading.gradient = TC_GRADIENT_CENTRAL;
    EACH_RENDERER(i) {
      render(i, volume, &scene, &plan);
      bool shaded = model != TC_SHADING_NONE;
      assert_int_equal(plan.stages[TC_STAGE_GRADIENT].included, shaded);
      assert_int_equal(plan.key.shading, model);
      assert_int_equal(plan.key.gradient, shaded ? TC_GRADIENT_CENTRAL : 0);
      assert_int_equal(strstr(plan.stages[TC_STAGE_GRADIENT].reason, "central differences") != NULL, shaded);
      assert_int_equal(strstr(plan.kernel, ".shaded.") != NULL, shaded);
    }
  }
}

/* The processor's underflow flag: shading computes no subnormal product, whatever the exponent (tc_shade.least_mirror). */
TEST(no_highlight_underflows) {
  g_autoptr(tc_volume) volume = waves(TC_I16, 1);
  const double shininess[] = {0, 0.5, 1, 10, 20, 127, 128, 300.5, 1024};
  EACH_CPU(i) {
    GError *error = NULL;
    g_autoptr(tc_renderer) here = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .isa = test_names[i], .threads = 1}, &error);
    assert_non_null(here);
    tc_frame frame = {0};
    for (size_t k = 0; k < 2 * G_N_ELEMENTS(shininess); k++) {
      g_auto(tc_scene) scene;
      shaded_scene(&scene, volume, TC_SHADING_BLINN_PHONG, soft, 3);
      scene.shading.gradient = k & 1 ? TC_GRADIENT_CENTRAL : TC_GRADIENT_CELL;
      scene.shading.shininess = shininess[k / 2];
      if (k % 3) light_from(&scene, 0.3, -1, 2);
      for (int again = 0; again < 2; again++) { /* the first frame builds its table as well */
        feclearexcept(FE_UNDERFLOW);
        assert_true(tc_render(here, volume, &scene, &(tc_render_request){0}, &frame, &error));
      }
      if (fetestexcept(FE_UNDERFLOW)) fail_msg("%s: shininess %g", test_names[i], scene.shading.shininess);
    }
    tc_frame_finish(&frame);
  }
}

static void refused(tc_volume *volume, const tc_scene *scene, const char *pointer) {
  GError *error = NULL;
  tc_explanation plan;
  assert_false(tc_explain(volume, scene, SIDE, SIDE, &plan, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_INVALID));
  assert_string_equal(tc_error_pointer(error), pointer);
  g_clear_error(&error);
}

TEST(nonsense_is_refused) {
  g_autoptr(tc_volume) volume = waves(TC_U8, 1);
  g_auto(tc_scene) scene;
  shaded_scene(&scene, volume, TC_SHADING_BLINN_PHONG, soft, 3);
  const tc_scene good = scene;
  const double shares[] = {-0.1, 1.1, NAN, INFINITY};
  for (size_t i = 0; i < G_N_ELEMENTS(shares); i++) {
    scene.shading.ambient = shares[i], refused(volume, &scene, "/shading/ambient"), scene = good;
    scene.shading.diffuse = shares[i], refused(volume, &scene, "/shading/diffuse"), scene = good;
    scene.shading.specular = shares[i], refused(volume, &scene, "/shading/specular"), scene = good;
    scene.shading.shininess = i == 1 ? 1025 : shares[i], refused(volume, &scene, "/shading/shininess"), scene = good;
  }
  scene.shading.gradient = TC_GRADIENT_COUNT, refused(volume, &scene, "/shading/gradient"), scene = good;
  light_from(&scene, 0, 0, 0), refused(volume, &scene, "/shading/light"), scene = good;
  light_from(&scene, 0, NAN, 1), refused(volume, &scene, "/shading/light"), scene = good;
}

/* One voxel along an axis, values near the ends of single precision, light straight from behind: finite everywhere. */
TEST(odd_volumes) {
  const int dims[][3] = {{1, 1, 1}, {1, 9, 9}, {9, 1, 9}, {9, 9, 1}, {2, 2, 2}};
  for (size_t d = 0; d < G_N_ELEMENTS(dims); d++)
    for (int e = -28; e <= 28; e += 28) {
      test_grid grid = {.dims = {dims[d][0], dims[d][1], dims[d][2]}, .type = TC_F32, .slope = d & 1 ? -1 : 1};
      double scale = pow(10, e);
      g_autoptr(tc_volume) volume = test_volume(&grid, test_linear, (double[4]){scale, 2 * scale, -scale, 0});
      tc_knot knot = {.value = 0, .color = {1, 0.5, 0}, .amount = 0.2};
      g_auto(tc_scene) scene;
      shaded_scene(&scene, volume, TC_SHADING_BLINN_PHONG, &knot, 1);
      for (int behind = 0; behind < 2; behind++) {
        double *from = scene.camera.position, *to = scene.camera.target;
        if (behind) light_from(&scene, to[0] - from[0], to[1] - from[1], to[2] - from[2]);
        g_autofree float *want = test_reference(volume, &scene, 1e-6);
        EACH_RENDERER(i) {
          test_difference diff = test_compare(render(i, volume, &scene, NULL), want, PIXELS);
          if (!diff.finite || !(diff.rms < 2e-3))
            fail_msg("%s: dims %d %d %d, scale %g: rms %g", test_names[i], dims[d][0], dims[d][1], dims[d][2], scale,
                     diff.rms);
        }
      }
    }
}

TESTS(test_renderers_open, test_renderers_close)
