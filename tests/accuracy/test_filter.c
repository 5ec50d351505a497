/* Filters of the field on every instruction set and OpenGL: against the reference integrator, against each other, with
 * and without skipping. Errors are of the linear frame and are printed as numbers. */
#include "tests/support/test.h"

#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "renderer/volume/coefficients.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

enum { SIDE = 32, PIXELS = SIDE * SIDE };

static const float *render(int which, tc_volume *volume, const tc_scene *scene, tc_explanation *plan) {
  return test_draw(which, volume, scene, NULL, plan)->linear;
}

/* Whether a renderer draws a mode of a voxel type: OpenGL draws a third of the pairs, every mode and every type among them, because
 * a program of the software rasterizer takes 0.3 s to compile; all with TC_LONG. */
static bool draws(int which, int type, int mode) { return which != GL || (type + mode) % 3 == 0 || getenv("TC_LONG"); }

/* ---- scenes ---- */

typedef struct kind {
  const char *name;
  tc_filter filter;
  bool prefilter;
} kind;
static const kind kinds[] = {{"nearest", TC_FILTER_NEAREST, false},
                             {"cubic", TC_FILTER_CUBIC, false},
                             {"interpolating cubic", TC_FILTER_CUBIC, true}};
enum { KINDS = sizeof kinds / sizeof *kinds };

static const tc_mode modes[] = {TC_MODE_DVR, TC_MODE_MIP, TC_MODE_MINIP, TC_MODE_AVERAGE, TC_MODE_MPR};
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
  scene->sampling.prefilter = k->prefilter;
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

/* The cubic field at an index position by its textbook formula, from numbers in the voxels' place. */
static double spline(double x) {
  x = fabs(x);
  return x < 1 ? (4 - 6 * x * x + 3 * x * x * x) / 6 : x < 2 ? (2 - x) * (2 - x) * (2 - x) / 6 : 0;
}

static double cubic_at(const int dims[3], const float *c, const double at[3]) {
  double sum = 0;
  for (int z = (int)floor(at[2]) - 1; z < floor(at[2]) + 3; z++)
    for (int y = (int)floor(at[1]) - 1; y < floor(at[1]) + 3; y++)
      for (int x = (int)floor(at[0]) - 1; x < floor(at[0]) + 3; x++) {
        int cx = CLAMP(x, 0, dims[0] - 1), cy = CLAMP(y, 0, dims[1] - 1), cz = CLAMP(z, 0, dims[2] - 1);
        sum +=
            spline(at[0] - x) * spline(at[1] - y) * spline(at[2] - z) * (double)c[(cz * dims[1] + cy) * dims[0] + cx];
      }
  return sum;
}

/* The reference's cubic is that formula wherever a ray is cut, and its extrema and means are the formula's. */
TEST(reference_is_cubic) {
  tc_knot knots[24];
  for (int i = 0; i < 24; i++) knots[i] = (tc_knot){.value = i / 24.0, .color = {1, 1, 1}, .amount = i % 2};
  unsigned seed = 3;
  for (int prefilter = 0; prefilter < 2; prefilter++) {
    g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {7, 5, 6}, .type = TC_F32}, test_noise, &seed);
    g_autoptr(tc_volume) coefficients = tc_coefficients_make(volume, NULL, NULL);
    const float *c = tc_volume_data(prefilter ? coefficients : volume);
    const int *dims = tc_volume_describe(volume)->dims;
    g_auto(tc_scene) scene;
    scene_of(&scene, volume, &kinds[1 + prefilter], TC_MODE_DVR, 1);
    test_scene_knots(&scene, TC_KNOT_EXTINCTION, knots, 24);
    scene.window.center = 0.5, scene.window.width = 4;
    double worst = 0, worst_mean = 0, worst_peak = 0;
    size_t cuts = 0;
    for (int ray = 0; ray < 60; ray++) {
      double x = SIDE / 2 + ray % 8 - 3.5, y = SIDE / 2 + ray / 8 - 3.5, mean[4], peak[4], most = -9, sum = 0,
             length = 0;
      tc_reference_sample *samples;
      size_t count;
      scene.mode = TC_MODE_DVR;
      tc_reference *r = tc_reference_new(volume, &scene, SIDE, SIDE, 0, NULL);
      tc_reference_ray(r, x, y, &samples, &count);
      tc_reference_free(r);
      assert_true(count > 5);
      cuts += count;
      for (size_t i = 0; i < count; i++) {
        worst = fmax(worst, fabs(samples[i].value - cubic_at(dims, c, samples[i].position)));
        const double *first = samples[0].position, *last = samples[count - 1].position;
        double whole = samples[count - 1].distance_mm - samples[0].distance_mm;
        for (int k = 0; k < 40; k++) {
          double at[3], mm = samples[i].distance_mm - samples[0].distance_mm + (k + 0.5) / 40 * samples[i].length_mm;
          for (int axis = 0; axis < 3; axis++) at[axis] = first[axis] + mm / whole * (last[axis] - first[axis]);
          double value = cubic_at(dims, c, at);
          most = fmax(most, value);
          sum += value * samples[i].length_mm / 40;
          /* Between two cuts the field goes one way. */
          assert_true(value >= fmin(samples[i].value, samples[i].value_back) - 1e-6);
          assert_true(value <= fmax(samples[i].value, samples[i].value_back) + 1e-6);
        }
        length += samples[i].length_mm;
      }
      scene.mode = TC_MODE_AVERAGE;
      r = tc_reference_new(volume, &scene, SIDE, SIDE, 0, NULL);
      tc_reference_pixel(r, x, y, mean);
      tc_reference_free(r);
      scene.mode = TC_MODE_MIP;
      r = tc_reference_new(volume, &scene, SIDE, SIDE, 0, NULL);
      tc_reference_pixel(r, x, y, peak);
      tc_reference_free(r);
      worst_mean = fmax(worst_mean, fabs((mean[0] - 0.5) * 4 + 0.5 - sum / length));
      worst_peak = fmax(worst_peak, fabs((peak[0] - 0.5) * 4 + 0.5 - most));
      g_free(samples);
    }
    printf("  %s: %zu cuts off by up to %.1e; means %.1e, maxima %.1e\n", kinds[1 + prefilter].name, cuts, worst,
           worst_mean, worst_peak);
    assert_true(worst < 5e-6 && worst_mean < 1e-4 && worst_peak < 2e-3);
  }
}

/* With ever smaller steps pictures become the reference's. */
TEST(close_to_reference) {
  g_autoptr(tc_volume) volume = waves(TC_F32);
  for (int k = 0; k < KINDS; k++)
    for (int m = 0; m < RAY_MODES; m++) {
      g_auto(tc_scene) scene;
      scene_of(&scene, volume, &kinds[k], modes[m], 1);
      g_autofree float *want = test_reference(volume, &scene, 1e-7);
      EACH_RENDERER(i) {
        double rms[2];
        test_difference d;
        for (int fine = 0; fine < 2; fine++) {
          scene.sampling.step = fine ? 0.04 : 0.2;
          d = test_compare(render(i, volume, &scene, NULL), want, PIXELS);
          assert_true(d.finite);
          rms[fine] = d.rms;
        }
        printf("  %s %s %s: rms %.1e at step 0.2, %.1e at 0.04 (max %.1e)\n", kinds[k].name, tc_mode_names[modes[m]],
               test_names[i], rms[0], rms[1], d.max);
        /* A peak of the nearest voxel's is missed where a ray cuts less than a step off its corner: half an order. */
        bool jumps = k == 0 && (modes[m] == TC_MODE_MIP || modes[m] == TC_MODE_MINIP);
        assert_true(rms[1] < 5e-3 && rms[1] < fmax((jumps ? 0.75 : 0.5) * rms[0], 3e-5) && fabs(d.mean) < 1e-3);
      }
    }
}

/* ---- agreement ---- */

static double columns(double x, double y, double z, const void *seed) { return test_noise(x, y, 0, seed); }

/* Parallel rays along columns of voxels, three pixels a voxel: every third one runs exactly halfway between two columns, and meets
 * the upper. The reference, too, is judged. */
TEST(halfway_the_upper_voxel_shows) {
  for (unsigned seed = 0; seed < 6; seed++) {
    const double mm = 0.7 + 0.13 * seed; /* a voxel */
    const test_grid grid = {.dims = {15, 15, 6}, .type = TC_F32, .spacing = {mm, mm, 1.1}, .origin = {131.7 * seed, -88.3, 40.9}};
    g_autoptr(tc_volume) volume = test_volume(&grid, columns, &seed);
    const double middle[3] = {grid.origin[0] + 7 * mm, grid.origin[1] + 7 * mm, grid.origin[2]};
    g_auto(tc_scene) scene;
    scene_of(&scene, volume, &kinds[0], (tc_mode)(TC_MODE_MIP + seed % 3), 0.5);
    test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){middle[0], middle[1], middle[2] - 50}, middle, SIDE * mm / 3);
    g_autofree float *reference = test_reference(volume, &scene, 0);
    for (int i = 0; i <= RENDERERS; i++) { /* the last: the reference */
      if (i < RENDERERS && !test_renderers[i]) continue;
      const float *image = i < RENDERERS ? render(i, volume, &scene, NULL) : reference;
      for (int p = 0; p < PIXELS; p++) { /* x falls from the left of the picture to the right */
        const double x = floor(7 - (p % SIDE + 0.5 - SIDE / 2) / 3 + 0.5 + 1e-6), y = floor(7 - (p / SIDE + 0.5 - SIDE / 2) / 3 + 0.5 + 1e-6);
        const double want = (columns(x, y, 0, &seed) - scene.window.center) / scene.window.width + 0.5;
        if (fabs((double)image[4 * p] - want) > (i == GL ? 1 / 255.0 : 1e-5))
          fail_msg("%u, %s: pixel %d,%d is %g, expected %g", seed, i < RENDERERS ? test_names[i] : "reference", p % SIDE, p / SIDE, (double)image[4 * p], want);
      }
    }
  }
}

TEST(everyone_agrees) {
  double worst[RENDERERS] = {0};
  size_t ties = 0, compared = 0;
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
    g_autoptr(tc_volume) volume = waves((tc_voxel_type)type);
    for (int k = 0; k < KINDS; k++)
      for (int m = 0; m < MODES + TC_SLAB_PROJECTION_COUNT; m++) {
        g_auto(tc_scene) scene;
        scene_of(&scene, volume, &kinds[k], modes[m < MODES ? m : MODES - 1], 0.7);
        if (m >= MODES - 1) scene.mpr.projection = (tc_slab_projection)(m - MODES);
        if (m == MODES - 1) scene.mpr.thickness_mm = 0, scene.mpr.projection = TC_SLAB_MIP;
        if (m == 0 && k % 2) scene.shading.model = TC_SHADING_BLINN_PHONG;
        render(SCALAR, volume, &scene, NULL);
        EACH_RENDERER(i) {
          if (i == SCALAR || !draws(i, type, m)) continue;
          const float *a = render(i, volume, &scene, NULL), *b = test_frames[SCALAR].linear;
          assert_true(test_compare(a, b, PIXELS).finite);
          for (size_t p = 0; p < PIXELS; p++) {
            const double d = test_pixel_off(a, b, p);
            compared++;
            if (d > 1.0 / 255) ties++; /* half way between two voxels, or on the volume's edge: rounding decides */
            else worst[i] = fmax(worst[i], d);
          }
        }
      }
  }
  EACH_RENDERER(i) if (i != SCALAR) printf("  %s against scalar: max %.2e but for ties\n", test_names[i], worst[i]);
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

TEST(skipping_changes_no_bit) {
  uint64_t random = 7;
  int skipped[RENDERERS] = {0};
  for (int trial = 0; trial < 40 * KINDS; trial++) {
    uint64_t seed = random;
    g_autoptr(tc_volume) volume = random_ball(&random);
    const kind *k = &kinds[trial % KINDS];
    g_auto(tc_scene) scene;
    scene_of(&scene, volume, k, modes[trial / KINDS % 3], 0.3 + test_random(&random));
    scene.skipping.block = 2 + (int)(6 * test_random(&random));
    if (trial % 7 == 0) scene.shading.model = TC_SHADING_LAMBERT;
    EACH_RENDERER(i) {
      scene.skipping.mode = TC_SKIPPING_OFF;
      g_autofree float *off = g_memdup2(render(i, volume, &scene, NULL), sizeof(float[4]) * PIXELS);
      uint64_t samples = test_frames[i].stats.samples;
      scene.skipping.mode = TC_SKIPPING_AUTO;
      if (memcmp(render(i, volume, &scene, NULL), off, sizeof(float[4]) * PIXELS))
        fail_msg("%s %s: trial %d (state %llu) differs", test_names[i], k->name, trial, (unsigned long long)seed);
      skipped[i] += test_frames[i].stats.samples < samples;
    }
  }
  EACH_RENDERER(i) {
    printf("  %s: %d of %d scenes took fewer samples\n", test_names[i], skipped[i], 40 * KINDS);
    assert_true(skipped[i] > 10 * KINDS);
  }
}

/* ---- exactness ---- */

/* Every filter of a constant is that constant: one picture for all of them. */
TEST(constants_stay) {
  static const int dims[][3] = {{9, 8, 7}, {1, 6, 5}, {2, 1, 3}, {1, 1, 1}, {3, 2, 1}};
  for (int shape = 0; shape < 5; shape++)
    for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
      test_grid g = {.type = (tc_voxel_type)type, .slope = 0.01};
      memcpy(g.dims, dims[shape], sizeof g.dims);
      g_autoptr(tc_volume) volume = test_volume(&g, test_constant, &(double){0.77});
      for (int m = 0; m < MODES; m++)
        EACH_RENDERER(i) {
          if (!draws(i, type, m)) continue;
          g_auto(tc_scene) scene;
          scene_of(&scene, volume, &(kind){"linear", TC_FILTER_LINEAR, false}, modes[m], 0.4);
          g_autofree float *linear = g_memdup2(render(i, volume, &scene, NULL), sizeof(float[4]) * PIXELS);
          for (int k = 0; k < KINDS; k++) {
            scene.filter = kinds[k].filter;
            scene.sampling.prefilter = kinds[k].prefilter;
            if (memcmp(render(i, volume, &scene, NULL), linear, sizeof(float[4]) * PIXELS))
              fail_msg("%s %s %s: shape %d differs from linear", test_names[i], kinds[k].name, tc_mode_names[modes[m]],
                       shape);
          }
        }
    }
}

/* ---- prefiltering ---- */

/* Pixels at voxel centres show the voxels themselves, also in the outermost layers; without prefiltering they do
 * not. */
TEST(prefilter_passes_through_voxels) {
  enum { N = 11 };
  unsigned seed = 8;
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
    g_autoptr(tc_volume) volume =
        test_volume(&(test_grid){.dims = {N, N, 4}, .type = (tc_voxel_type)type, .slope = 0.01}, test_noise, &seed);
    for (int z = 0; z < 4; z++)
      EACH_RENDERER(i) {
        double worst[2] = {0};
        for (int prefilter = 0; prefilter < 2; prefilter++) {
          g_auto(tc_scene) scene;
          scene_of(&scene, volume, &kinds[1 + prefilter], TC_MODE_MPR, 1);
          scene.image.width = scene.image.height = N;
          scene.mpr.orientation = TC_AXIAL;
          scene.mpr.thickness_mm = 0;
          scene.mpr.zoom = (N - 1.0) / N;
          scene.mpr.has_center = true;
          memcpy(scene.mpr.center, (double[3]){0.5 * (N - 1), 0.5 * (N - 1), z}, sizeof scene.mpr.center);
          scene.window.width = 1;
          const float *got = render(i, volume, &scene, NULL);
          for (int p = 0; p < N * N; p++) {
            double value;
            assert_true(tc_volume_value_at(volume, (double[3]){p % N, p / N, z}, &value));
            worst[prefilter] = fmax(worst[prefilter], fabs((double)got[4 * p] - fmin(fmax(value, 0), 1)));
          }
        }
        if (type == TC_F32 && z == 0) printf("  %s: off by %.1e, smoothed %.1e\n", test_names[i], worst[1], worst[0]);
        assert_true(worst[1] < 2e-5 && worst[0] > 0.05);
      }
  }
}

/* Built once, shared by scenes, dropped with the volume; what does not fit the cache is refused with the mend. */
TEST(coefficients_are_a_resource) {
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  tc_explanation plan;
  scene_of(&scene, volume, &kinds[2], TC_MODE_DVR, 1);
  EACH_RENDERER(i) {
    tc_renderer_forget(test_renderers[i], volume);
    render(i, volume, &scene, &plan);
    const tc_explained_stage *stage = &plan.stages[TC_STAGE_COEFFICIENTS];
    assert_true(stage->included && test_frames[i].stats.coefficients_ms > 0);
    assert_int_equal(stage->bytes, 4 * tc_volume_bytes(volume));
    scene.mode = TC_MODE_MIP;
    render(i, volume, &scene, NULL);
    assert_true(test_frames[i].stats.coefficients_ms == 0);
    tc_renderer_forget(test_renderers[i], volume);
    render(i, volume, &scene, NULL);
    assert_true(test_frames[i].stats.coefficients_ms > 0);
    scene.sampling.prefilter = false;
    scene.mode = TC_MODE_DVR;
    render(i, volume, &scene, &plan);
    assert_true(!stage->included && stage->bytes == 0 && test_frames[i].stats.coefficients_ms == 0);
    scene.sampling.prefilter = true;
  }
  tc_renderer_options small = {.backend = TC_BACKEND_CPU, .cache_bytes = 4 * tc_volume_bytes(volume) - 1};
  g_autoptr(tc_renderer) r = tc_renderer_new(&small, NULL);
  g_autoptr(GError) error = NULL;
  assert_false(tc_render(r, volume, &scene, NULL, &test_frames[SCALAR], &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT));
  assert_string_equal(tc_error_pointer(error), "/sampling/prefilter");
}

TESTS(test_renderers_open, test_renderers_close)
