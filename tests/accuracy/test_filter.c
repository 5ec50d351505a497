/* Filters of the field on every instruction set and OpenGL: against the reference integrator, against each other, with and
 * without skipping. Errors are of the linear frame and are printed as numbers. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

#include <cmocka.h>

#include "renderer/gl/device.h"
#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"

enum { SCALAR, AVX2, AVX512, GL, RENDERERS, SIDE = 40, PIXELS = SIDE * SIDE };
static const char *const names[RENDERERS] = {"scalar", "avx2", "avx512", "gl"};
static tc_renderer *renderers[RENDERERS];
static tc_frame frames[RENDERERS];

static int set_up(void **state) {
  tc_gl_report report;
  for (int i = 0; i < RENDERERS; i++) {
    GError *error = NULL;
    tc_renderer_options options = {.backend = i == GL ? TC_BACKEND_GL : TC_BACKEND_CPU, .threads = 2};
    if (i != GL) options.isa = names[i];
    if (i != GL || tc_gl_report_read(&report, &error)) renderers[i] = tc_renderer_new(&options, &error);
    if (!renderers[i]) printf("  %s: not checked: %s\n", names[i], error->message);
    g_clear_error(&error);
  }
  return !renderers[SCALAR];
}

static int tear_down(void **state) {
  for (int i = 0; i < RENDERERS; i++) {
    tc_frame_finish(&frames[i]);
    tc_renderer_free(renderers[i]);
  }
  return 0;
}

static const float *render(int which, tc_volume *volume, const tc_scene *scene, tc_plan *plan) {
  GError *error = NULL;
  const tc_render_request request = {.want_linear = true};
  if (!tc_render(renderers[which], volume, scene, &request, &frames[which], plan, &error))
    fail_msg("%s: %s", names[which], error->message);
  return frames[which].linear;
}

#define EACH_RENDERER(i) for (int i = 0; i < RENDERERS; i++) if (renderers[i])

/* ---- scenes ---- */

typedef struct kind {
  const char *name;
  tc_filter filter;
} kind;
static const kind kinds[] = {{"nearest", TC_FILTER_NEAREST}};
enum { KINDS = sizeof kinds / sizeof *kinds };

static const tc_mode modes[] = {TC_MODE_DVR, TC_MODE_MIP, TC_MODE_MINIP, TC_MODE_AVERAGE, TC_MODE_MPR};
static const char *const mode_names[] = {"dvr", "mip", "minip", "average", "mpr"};
enum { MODES = 5, RAY_MODES = 4 };

static const tc_knot soft[] = {{.value = 0.2, .color = {0.1, 0.2, 1}, .amount = 0},
                               {.value = 0.5, .color = {0.3, 0.9, 0.4}, .amount = 0.05},
                               {.value = 1, .color = {1, 0.6, 0.2}, .amount = 0.4}};

static void scene_of(tc_scene *scene, const tc_volume *volume, const kind *k, tc_mode mode, double step) {
  test_scene(scene, SIDE, SIDE);
  test_scene_knots(scene, TC_KNOT_EXTINCTION, soft, 3);
  test_scene_frame(scene, volume, TC_PERSPECTIVE, (double[3]){1, -0.6, 0.4});
  scene->mode = mode;
  scene->filter = k->filter;
  scene->sampling.step = step;
  scene->window.center = 0.5, scene->window.width = 1.2;
  scene->mpr.orientation = TC_OBLIQUE;
  scene->mpr.normal[0] = 0.3, scene->mpr.normal[1] = 0.5, scene->mpr.normal[2] = 1;
  scene->mpr.thickness_mm = 6;
}

/* Stored in steps of 1/100 by integer types, so that coarse voxels are checked too. */
static tc_volume *waves(tc_voxel_type type) {
  return test_volume(&(test_grid){.dims = {17, 14, 15}, .type = type, .slope = type == TC_F32 ? 1 : 0.01}, test_waves,
                     &(double){9});
}

/* ---- truth ---- */

static float *truth(tc_volume *volume, const tc_scene *scene) {
  GError *error = NULL;
  tc_reference *reference = tc_reference_new(volume, scene, SIDE, SIDE, 1e-7, &error);
  if (!reference) fail_msg("%s", error->message);
  float *image = g_new(float, 4 * PIXELS);
  if (!tc_reference_image(reference, 2, image, &error)) fail_msg("%s", error->message);
  tc_reference_free(reference);
  return image;
}

/* With ever smaller steps pictures become the reference's. */
static void close_to_reference(void **state) {
  tc_volume *volume = waves(TC_F32);
  for (int k = 0; k < KINDS; k++)
    for (int m = 0; m < RAY_MODES; m++) {
      tc_scene scene;
      scene_of(&scene, volume, &kinds[k], modes[m], 1);
      float *want = truth(volume, &scene);
      EACH_RENDERER(i) {
        double rms[2];
        test_difference d;
        for (int fine = 0; fine < 2; fine++) {
          scene.sampling.step = fine ? 0.04 : 0.2;
          d = test_compare(render(i, volume, &scene, NULL), want, PIXELS);
          assert_true(d.finite);
          rms[fine] = d.rms;
        }
        printf("  %s %s %s: rms %.1e at step 0.2, %.1e at 0.04 (max %.1e)\n", kinds[k].name, mode_names[m], names[i], rms[0],
               rms[1], d.max);
        assert_true(rms[1] < 3e-3 && rms[1] < fmax(0.5 * rms[0], 3e-5) && fabs(d.mean) < 1e-3);
      }
      g_free(want);
      tc_scene_clear(&scene);
    }
  tc_volume_unref(volume);
}

/* ---- agreement ---- */

static void everyone_agrees(void **state) {
  double worst[RENDERERS] = {0};
  size_t ties = 0, compared = 0;
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
    tc_volume *volume = waves((tc_voxel_type)type);
    for (int k = 0; k < KINDS; k++)
      for (int m = 0; m < MODES + TC_SLAB_PROJECTION_COUNT; m++) {
        tc_scene scene;
        scene_of(&scene, volume, &kinds[k], modes[m < MODES ? m : MODES - 1], 0.7);
        if (m >= MODES - 1) scene.mpr.projection = (tc_slab_projection)(m - MODES);
        if (m == MODES - 1) scene.mpr.thickness_mm = 0, scene.mpr.projection = TC_SLAB_MIP;
        if (m == 0 && k % 2) scene.shading.model = TC_SHADING_BLINN_PHONG;
        render(SCALAR, volume, &scene, NULL);
        EACH_RENDERER(i) {
          if (i == SCALAR) continue;
          const float *a = render(i, volume, &scene, NULL), *b = frames[SCALAR].linear;
          assert_true(test_compare(a, b, PIXELS).finite);
          for (size_t p = 0; p < PIXELS; p++) {
            double d = 0;
            for (size_t c = 4 * p; c < 4 * p + 4; c++) d = fmax(d, fabs((double)a[c] - (double)b[c]));
            compared++;
            if (d > 1.0 / 255) ties++; /* half way between two voxels, or on the volume's edge: rounding decides */
            else worst[i] = fmax(worst[i], d);
          }
        }
        tc_scene_clear(&scene);
      }
    tc_volume_unref(volume);
  }
  EACH_RENDERER(i) if (i != SCALAR) printf("  %s against scalar: max %.2e but for ties\n", names[i], worst[i]);
  printf("  over 1/255: %zu of %zu pixels\n", ties, compared);
  assert_true((double)ties <= 1e-3 * (double)compared);
}

/* ---- skipping ---- */

/* A soft ball in still air, or in noise: some blocks empty, some nearly, some full. */
static double ball(double x, double y, double z, const void *context) {
  const double *b = context;
  unsigned seed = (unsigned)b[5];
  double d = sqrt((x - b[0]) * (x - b[0]) + (y - b[1]) * (y - b[1]) + (z - b[2]) * (z - b[2]));
  return fmax(0, 1 - d / b[3]) + b[4] * test_noise(x, y, z, &seed);
}

static tc_volume *random_ball(uint64_t *state) {
  test_grid g = {.type = (tc_voxel_type)(TC_VOXEL_TYPE_COUNT * test_random(state)), .slope = 0.01};
  double b[6];
  for (int k = 0; k < 3; k++) {
    g.dims[k] = 1 + (int)(40 * test_random(state));
    g.spacing[k] = 0.4 + 2 * test_random(state);
    b[k] = g.dims[k] * test_random(state);
  }
  b[3] = 2 + 9 * test_random(state);
  b[4] = test_random(state) < 0.5 ? 0 : 0.1;
  b[5] = (double)*state;
  return test_volume(&g, ball, b);
}

static void skipping_changes_no_bit(void **state) {
  uint64_t random = 7;
  int skipped[RENDERERS] = {0};
  for (int trial = 0; trial < 40 * KINDS; trial++) {
    uint64_t seed = random;
    tc_volume *volume = random_ball(&random);
    const kind *k = &kinds[trial % KINDS];
    tc_scene scene;
    scene_of(&scene, volume, k, modes[trial / KINDS % 3], 0.3 + test_random(&random));
    scene.skipping.block = 2 + (int)(6 * test_random(&random));
    if (trial % 7 == 0) scene.shading.model = TC_SHADING_LAMBERT;
    EACH_RENDERER(i) {
      scene.skipping.mode = TC_SKIPPING_OFF;
      float *off = g_memdup2(render(i, volume, &scene, NULL), sizeof(float[4]) * PIXELS);
      uint64_t samples = frames[i].stats.samples;
      scene.skipping.mode = TC_SKIPPING_AUTO;
      if (memcmp(render(i, volume, &scene, NULL), off, sizeof(float[4]) * PIXELS))
        fail_msg("%s %s: trial %d (state %llu) differs", names[i], k->name, trial, (unsigned long long)seed);
      skipped[i] += frames[i].stats.samples < samples;
      g_free(off);
    }
    tc_scene_clear(&scene);
    tc_volume_unref(volume);
  }
  EACH_RENDERER(i) {
    printf("  %s: %d of %d scenes took fewer samples\n", names[i], skipped[i], 40 * KINDS);
    assert_true(skipped[i] > 10 * KINDS);
  }
}

/* ---- exactness ---- */

/* Every filter of a constant is that constant: one picture for all of them. */
static void constants_stay(void **state) {
  static const int dims[][3] = {{9, 8, 7}, {1, 6, 5}, {2, 1, 3}, {1, 1, 1}, {3, 2, 1}};
  for (int shape = 0; shape < 5; shape++)
    for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
      test_grid g = {.type = (tc_voxel_type)type, .slope = 0.01};
      memcpy(g.dims, dims[shape], sizeof g.dims);
      tc_volume *volume = test_volume(&g, test_constant, &(double){0.77});
      for (int m = 0; m < MODES; m++)
        EACH_RENDERER(i) {
          tc_scene scene;
          scene_of(&scene, volume, &(kind){"linear", TC_FILTER_LINEAR}, modes[m], 0.4);
          float *linear = g_memdup2(render(i, volume, &scene, NULL), sizeof(float[4]) * PIXELS);
          for (int k = 0; k < KINDS; k++) {
            scene.filter = kinds[k].filter;
            if (memcmp(render(i, volume, &scene, NULL), linear, sizeof(float[4]) * PIXELS))
              fail_msg("%s %s %s: shape %d differs from linear", names[i], kinds[k].name, mode_names[m], shape);
          }
          tc_scene_clear(&scene);
          g_free(linear);
        }
      tc_volume_unref(volume);
    }
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(close_to_reference), cmocka_unit_test(everyone_agrees),
                                     cmocka_unit_test(skipping_changes_no_bit), cmocka_unit_test(constants_stay)};
  return cmocka_run_group_tests(tests, set_up, tear_down);
}
