/* mip, minip and average: every instruction set and gl against the exact extremum or mean along each ray, and skipping
 * against none, bit for bit. Errors are of the linear frame and are printed as numbers. */
#include "tests/support/test.h"

#include "renderer/tomocast.h"
#include "renderer/classify/preintegration.h"
#include "renderer/classify/transfer.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

static const tc_mode modes[] = {TC_MODE_MIP, TC_MODE_MINIP, TC_MODE_AVERAGE};

static const tc_frame *render(int i, tc_volume *volume, const tc_scene *scene, tc_explanation *plan) {
  return test_draw(i, volume, scene, NULL, plan);
}

/* Grey and opacity 1, or nothing; never NaN. */
static void check_sane(const char *what, const tc_frame *frame) {
  for (size_t i = 0; i < (size_t)frame->width * (size_t)frame->height; i++) {
    const float *c = frame->linear + 4 * i;
    bool grey = c[0] == c[1] && c[1] == c[2], met = c[3] == 1 && c[0] >= 0 && c[0] <= 1,
         missed = c[3] == 0 && c[0] == 0;
    if (!grey || (!met && !missed)) fail_msg("%s: pixel %zu is %g %g %g %g", what, i, c[0], c[1], c[2], c[3]);
  }
}

static void set_window(tc_scene *scene, double lo, double hi) {
  scene->window.center = 0.5 * (lo + hi);
  scene->window.width = hi - lo;
}

static double waves(double x, double y, double z, const void *context) {
  const double *c = context; /* amplitude, offset */
  double wavelength = 11;
  return c[0] * test_waves(x, y, z, &wavelength) + c[1];
}

static tc_volume *wave_volume(tc_voxel_type type, double slope) {
  const double range[5][2] = {{250, 0}, {120, 0}, {40000, 100}, {3000, -1000}, {2, -0.5}};
  test_grid grid = {.dims = {33, 27, 30}, .type = type, .spacing = {1, 0.8, 1.5}, .slope = slope};
  if (slope < 0) grid.intercept = range[type][0] + 2 * range[type][1];
  return test_volume(&grid, waves, range[type]);
}

/* ---- against the exact projections ---- */

/* The field has kinks at cell faces, and extrema sit on them: one found between samples is off in proportion to the
 * step, a third of what the greatest sample alone is off (1.1e-2 at step 1). The trapezoids of the mean fall with its square. Bounds: 1.5 times what was measured. */
TEST(close_to_reference) {
  static const double steps[] = {1, 0.5, 0.25, 0.125};
  static const double bounds[3][4] = {
      {7.1e-3, 2.9e-3, 2.9e-3, 5.8e-4}, {7.1e-3, 2.9e-3, 2.9e-3, 5.8e-4}, {4.6e-3, 1e-3, 2.8e-4, 6e-5}};
  for (int m = 0; m < 3; m++)
    for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
      g_autoptr(tc_volume) volume = wave_volume((tc_voxel_type)type, 1);
      const tc_volume_stats *range = tc_volume_statistics(volume);
      g_auto(tc_scene) scene;
      test_scene(&scene, 40, 36);
      test_scene_frame(&scene, volume, type % 2 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE, (double[3]){0.5, -1, 0.3});
      scene.mode = modes[m];
      set_window(&scene, range->min, range->max);
      g_autofree float *want = test_reference(volume, &scene, 0);
      double rms[4][4];
      for (int s = 0; s < 4; s++)
        EACH_RENDERER(i) {
          scene.sampling.step = steps[s];
          const tc_frame *frame = render(i, volume, &scene, NULL);
          check_sane(test_names[i], frame);
          size_t pixels = (size_t)frame->width * (size_t)frame->height, ties = 0;
          double sum = 0, max = 0;
          for (size_t p = 0; p < pixels; p++) {
            if (frame->linear[4 * p + 3] != want[4 * p + 3]) { /* a ray that grazes an edge of the box */
              ties++;
              continue;
            }
            double d = (double)frame->linear[4 * p] - (double)want[4 * p];
            sum += d * d;
            max = fmax(max, fabs(d));
            /* A sample is a value of the field: no maximum of them is above the exact one, no minimum below, but for
             * the single precision of a sample's place. */
            if (m < 2 && (m == 0 ? d : -d) > 1e-5)
              fail_msg("%s %s: beyond the exact one by %g", tc_mode_names[modes[m]], test_names[i], d);
          }
          rms[s][i] = sqrt(sum / (double)pixels);
          if (i == 0 || (i == GL && type == TC_U16))
            printf("  %-7s %-3s %-6s step %-5g rms %.2e max %.2e ties %zu\n", tc_mode_names[modes[m]],
                   tc_voxel_type_name((tc_voxel_type)type), test_names[i], steps[s], rms[s][i], max, ties);
          if (max > bounds[m][s] || ties > 2)
            fail_msg("%s, %s, step %g: max %g (bound %g), %zu ties", tc_mode_names[modes[m]], test_names[i], steps[s],
                     max, bounds[m][s], ties);
        }
      EACH_RENDERER(i) { /* from step 1 to 1/8: order 1 is a factor of 8, order 2 one of 64 */
        double gain = rms[0][i] / rms[3][i];
        if (!(gain > (m < 2 ? 6 : 40)))
          fail_msg("%s, %s: the error falls by %g only", tc_mode_names[modes[m]], test_names[i], gain);
      }
    }
}

/* Values stored upside down give the same picture as values stored upright: mip stays the maximum of values. */
TEST(inverted_slope) {
  for (int m = 0; m < 3; m++)
    for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++) {
      tc_volume *upright = wave_volume((tc_voxel_type)type, 1), *inverted = wave_volume((tc_voxel_type)type, -1);
      const tc_volume_stats *range = tc_volume_statistics(upright);
      assert_true(tc_volume_describe(inverted)->slope < 0);
      assert_float_equal(tc_volume_statistics(inverted)->max, range->max, 1e-6);
      g_auto(tc_scene) scene;
      test_scene(&scene, 30, 26);
      test_scene_frame(&scene, upright, TC_PERSPECTIVE, (double[3]){-0.4, -1, 0.2});
      scene.mode = modes[m];
      set_window(&scene, range->min + 0.1 * (range->max - range->min), range->max);
      EACH_RENDERER(i) {
        float want[30 * 26 * 4];
        memcpy(want, render(i, upright, &scene, NULL)->linear, sizeof want);
        test_difference d = test_compare(render(i, inverted, &scene, NULL)->linear, want, 30 * 26);
        if (!(d.max < 2e-5))
          fail_msg("%s %s %s: off by %g", tc_mode_names[modes[m]], tc_voxel_type_name((tc_voxel_type)type),
                   test_names[i], d.max);
      }
      tc_volume_unref(upright);
      tc_volume_unref(inverted);
    }
}

/* A ray straight through a ramp: extrema at its two ends, the last of which no whole step reaches; the mean in the
 * middle. */
TEST(closed_forms) {
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {12, 9, 9}, .type = TC_F32}, test_linear, (double[4]){10, 0, 0, -20});
  g_auto(tc_scene) scene;
  test_scene(&scene, 7, 5);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){-20, 4, 4}, (double[3]){0, 4, 4}, 6);
  set_window(&scene, -100, 100); /* values run from -20 to 90 */
  const double want[] = {0.95, 0.4, 0.675};
  for (int m = 0; m < 3; m++)
    for (int linear = 0; linear < 2; linear++)
      for (double step = 0.3; step < 40; step *= 1.9)
        EACH_RENDERER(i) {
          scene.mode = modes[m];
          scene.sampling.step = step;
          scene.image.linear_light = linear;
          const tc_frame *frame = render(i, volume, &scene, NULL);
          check_sane("ramp", frame);
          double c = want[m], expected = linear ? pow((c + 0.055) / 1.055, 2.4) : c;
          for (int p = 0; p < 35; p++) {
            if (fabs((double)frame->linear[4 * p] - expected) > 2e-6)
              fail_msg("%s %s step %g: %g, expected %g", tc_mode_names[modes[m]], test_names[i], step,
                       (double)frame->linear[4 * p], expected);
            /* Through linear light and back a grey is the display value that the window made. */
            assert_true(abs(frame->rgba[4 * p] - (int)(c * 255 + 0.5)) <= linear);
            assert_int_equal(frame->rgba[4 * p + 3], 255);
          }
        }
}

/* ---- shapes and numbers at the edge ---- */

TEST(thin_volumes) {
  static const int dims[][3] = {{1, 1, 1}, {1, 9, 1}, {7, 1, 1}, {1, 1, 12},
                                {5, 6, 1}, {1, 4, 3}, {2, 2, 2}, {3, 12, 2}};
  unsigned seed = 3;
  for (size_t d = 0; d < G_N_ELEMENTS(dims); d++)
    for (int m = 0; m < 3; m++) {
      test_grid grid = {.type = TC_F32, .spacing = {1, 2, 0.7}};
      memcpy(grid.dims, dims[d], sizeof grid.dims);
      g_autoptr(tc_volume) volume = test_volume(&grid, test_noise, &seed);
      g_auto(tc_scene) scene;
      test_scene(&scene, 20, 20);
      test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.3, -1, 0.2});
      scene.mode = modes[m];
      scene.sampling.step = 0.02;
      set_window(&scene, 0, 1);
      g_autofree float *want = test_reference(volume, &scene, 0);
      EACH_RENDERER(i) {
        const tc_frame *frame = render(i, volume, &scene, NULL);
        check_sane("thin", frame);
        int off = 0, met = 0;
        for (int p = 0; p < 400; p++) {
          met += frame->linear[4 * p + 3] > 0;
          off += frame->linear[4 * p + 3] != want[4 * p + 3] || fabsf(frame->linear[4 * p] - want[4 * p]) > 0.01f;
        }
        if (off > 2 || met == 0)
          fail_msg("%dx%dx%d %s %s: %d pixels off", dims[d][0], dims[d][1], dims[d][2], tc_mode_names[modes[m]],
                   test_names[i], off);
      }
    }
}

/* A constant field is exact, windows at either side of it black or white, and windows of any width finite. */
TEST(constants_and_extreme_windows) {
  const double value = 100;
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {20, 15, 300}, .type = TC_I16}, test_constant, &value);
  g_autoptr(tc_volume) huge =
      test_volume(&(test_grid){.dims = {9, 9, 9}, .type = TC_F32, .slope = 1e-9}, test_constant, &value);
  static const struct { double center, width, grey;
  } windows[] = {{100, 50, 0.5}, {110, 40, 0.25},    {500, 100, 0},     {-500, 100, 1},  {99, 1e-9, 1},
                 {101, 1e-9, 0}, {99, 1e-320, 1},    {101, 1e-320, 0},  {0, 1e300, 0.5}, {1e300, 1, 0},
                 {-1e300, 1, 1}, {1e300, 1e-300, 0}, {-1e308, 1e308, 1}};
  for (size_t w = 0; w < G_N_ELEMENTS(windows); w++)
    for (int m = 0; m < 3; m++)
      EACH_RENDERER(i)
        for (int k = 0; k < 2; k++) {
          g_auto(tc_scene) scene;
          test_scene(&scene, 9, 9);
          test_scene_frame(&scene, k ? huge : volume, TC_PERSPECTIVE, (double[3]){0.1, 0.2, 1});
          scene.mode = modes[m];
          scene.sampling.step = 0.37;
          scene.window.center = windows[w].center;
          scene.window.width = windows[w].width;
          const tc_frame *frame = render(i, k ? huge : volume, &scene, NULL);
          check_sane("constant", frame);
          const float *c = frame->linear + 4 * (4 * 9 + 4);
          if (fabs((double)c[0] - windows[w].grey) > 2e-6)
            fail_msg("window %g/%g %s %s: %g, expected %g", windows[w].center, windows[w].width, tc_mode_names[modes[m]],
                     test_names[i], (double)c[0], windows[w].grey);
        }
}

/* Clipped, a projection is that of what is left of each ray. */
/* In linear light each ray's grey is decoded before the mean of a pixel's rays: at an edge too, colour is opacity times
 * the light. */
TEST(edges_in_linear_light) {
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {9, 8, 7}, .type = TC_F32}, test_constant, &(double){0.5});
  for (int m = 0; m < 3; m++)
    EACH_RENDERER(i) {
      g_auto(tc_scene) scene;
      test_scene(&scene, 24, 24);
      test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.5, -1, 0.3});
      scene.mode = modes[m];
      set_window(&scene, 0, 1);
      scene.image.linear_light = true;
      scene.sampling.rays_per_pixel = 4;
      const tc_frame *frame = render(i, volume, &scene, NULL);
      int edges = 0;
      for (int p = 0; p < 24 * 24; p++) {
        const float *c = frame->linear + 4 * p;
        edges += c[3] > 0 && c[3] < 1;
        if (!(fabs(c[0] - c[3] * tc_srgb_to_linear(0.5)) < 1e-5))
          fail_msg("%s, %s: %g at %g", test_names[i], tc_mode_names[modes[m]], c[0], c[3]);
      }
      assert_true(edges > 20);
    }
}

TEST(clipped) {
  g_autoptr(tc_volume) volume = wave_volume(TC_F32, 1);
  for (int m = 0; m < 3; m++) {
    g_auto(tc_scene) scene;
    test_scene(&scene, 40, 36);
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.3, -1, 0.4});
    scene.mode = modes[m];
    scene.sampling.step = 0.1;
    set_window(&scene, -0.5, 1.5);
    scene.clip.has_box = true;
    memcpy(scene.clip.box, (double[2][3]){{3.3, 2.2, 5.1}, {28, 17, 33}}, sizeof scene.clip.box);
    scene.clip.n_planes = 1;
    memcpy(scene.clip.planes[0], (double[4]){1, 1, -0.5, -6}, sizeof scene.clip.planes[0]);
    g_autofree float *want = test_reference(volume, &scene, 0);
    EACH_RENDERER(i) {
      tc_explanation plan;
      const tc_frame *frame = render(i, volume, &scene, &plan);
      check_sane(test_names[i], frame);
      assert_true(plan.stages[TC_STAGE_CLIPPING].included);
      int off = 0, met = 0;
      double max = 0;
      for (int p = 0; p < 40 * 36; p++) {
        met += frame->linear[4 * p + 3] > 0;
        if (frame->linear[4 * p + 3] != want[4 * p + 3])
          off++;
        else
          max = fmax(max, fabs((double)frame->linear[4 * p] - (double)want[4 * p]));
      }
      printf("  clipped %s %s: max %.1e, %d of %d pixels at an edge\n", tc_mode_names[modes[m]], test_names[i], max,
             off, met);
      if (off > 2 || met < 200 || max > 4e-3)
        fail_msg("%s %s: %d of %d pixels off, max %g", tc_mode_names[modes[m]], test_names[i], off, met, max);
    }
  }
}

/* ---- skipping ---- */

typedef struct blobs { uint64_t seed; int count; double noise; } blobs;

static double blob_field(double x, double y, double z, const void *context) {
  const blobs *b = context;
  uint64_t state = b->seed;
  double v = 0;
  for (int i = 0; i < b->count; i++) {
    double cx = 90 * test_random(&state), cy = 90 * test_random(&state), cz = 90 * test_random(&state);
    double r = 1 + 9 * test_random(&state), d = sqrt((x - cx) * (x - cx) + (y - cy) * (y - cy) + (z - cz) * (z - cz));
    v = fmax(v, 120 * fmax(0, 1 - d / r));
  }
  unsigned seed = (unsigned)b->seed;
  return fmin(v, 110) + b->noise * test_noise(x, y, z, &seed);
}

static tc_volume *random_volume(uint64_t *state) {
  blobs b = {*state, 1 + (int)(6 * test_random(state)), 15 * floor(2 * test_random(state))};
  test_grid g = {.type = (tc_voxel_type)(5 * test_random(state))};
  int least = test_random(state) < 0.2 ? 1 : 25;
  for (int k = 0; k < 3; k++)
    g.dims[k] = least + (int)(70 * test_random(state)), g.spacing[k] = 0.4 + 2 * test_random(state);
  if (test_random(state) < 0.3) g.slope = -0.9, g.intercept = g.type == TC_U8 || g.type == TC_U16 ? 130 : 20;
  /* Sheared axes, as of a tilted gantry. */
  if (test_random(state) < 0.3) memcpy(g.direction, (double[9]){1, 0.3, 0, 0, 0.95394, 0, 0, 0, 1}, sizeof g.direction);
  return test_volume(&g, blob_field, &b);
}

static void random_scene(tc_scene *s, const tc_volume *v, int trial, uint64_t *state) {
  test_scene(s, 41, 37);
  double side[3] = {test_random(state) - 0.5, test_random(state) - 0.5, test_random(state) - 0.5};
  if (trial % 5 == 0) side[1] = 0;
  if (trial % 10 == 0) side[2] = 0; /* along an axis */
  test_scene_frame(s, v, trial % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
  if (trial % 7 == 3) /* from inside */
    for (int k = 0; k < 3; k++) s->camera.position[k] = 0.9 * s->camera.target[k] + 0.1 * s->camera.position[k];
  if (trial % 9 == 4) {
    s->clip.n_planes = 1;
    for (int k = 0; k < 3; k++) {
      s->clip.planes[0][k] = test_random(state) - 0.5;
      s->clip.planes[0][3] -= s->clip.planes[0][k] * s->camera.target[k];
    }
  }
  s->mode = modes[trial % 3 == 0];
  s->sampling.step = 0.3 + (trial % 4 ? 2 : 12) * test_random(state);
  s->skipping.block = trial % 3 ? 2 + (int)(6 * test_random(state)) : 0;
  /* Now and then all of the volume is on one side of the window. */
  double lo = -20 + (trial % 8 ? 60 : 160) * test_random(state);
  set_window(s, lo, lo + (trial % 3 ? 150 : 10) * test_random(state) + 0.01);
  s->image.linear_light = trial % 6 == 1;
  s->image.transparent = trial % 4 == 2;
}

TEST(skipping_changes_no_bit) {
  EACH_RENDERER(r) {
    uint64_t with = 0, without = 0, seeds = 7;
    int skipped = 0, shown = 0, trials = (r == GL ? 60 : 150) / STRIDE(3);
    for (int trial = 0; trial < trials; trial++) {
      uint64_t seed = seeds;
      g_autoptr(tc_volume) v = random_volume(&seeds);
      g_auto(tc_scene) s;
      g_auto(tc_frame) on = {0}, off = {0};
      tc_render_request q = {.want_linear = true};
      random_scene(&s, v, trial, &seeds);
      assert_true(tc_render(test_renderers[r], v, &s, &q, &on, NULL));
      s.skipping.mode = TC_SKIPPING_OFF;
      assert_true(tc_render(test_renderers[r], v, &s, &q, &off, NULL));
      check_sane(test_names[r], &on);
      size_t pixels = (size_t)on.width * (size_t)on.height;
      if (memcmp(on.linear, off.linear, pixels * 16) || memcmp(on.rgba, off.rgba, pixels * 4))
        fail_msg("%s: trial %d (state %llu, block %d) differs", test_names[r], trial, (unsigned long long)seed,
                 s.skipping.block);
      assert_int_equal(off.stats.leaps, 0);
      with += on.stats.samples, without += off.stats.samples;
      skipped += on.stats.leaps > 0;
      for (size_t i = 0; i < pixels; i++)
        if (off.linear[4 * i] > 0 && off.linear[4 * i] < 1) {
          shown++;
          break;
        }
    }
    printf("%s: %d scenes, %d with greys, %d skipped in, %.2f of the samples taken\n", test_names[r], trials, shown,
           skipped, (double)with / (double)without);
    assert_true(shown > trials / 3 && skipped > trials / 6 && with < without); /* the trial is worth something */
  }
}

/* A grey core in the dark, and on the faces of the box brighter lines one voxel wide, far apart. */
static double lines(double x, double y, double z, const void *context) {
  const test_grid *grid = context;
  double at[3] = {x, y, z}, from_middle = 0;
  bool on_line = false;
  for (int k = 0; k < 3; k++) {
    on_line |= (at[k] == 0 || at[k] == grid->dims[k] - 1) && (int)at[(k + 1) % 3] % 20 == 10;
    from_middle += pow(at[k] - 0.5 * grid->dims[k], 2);
  }
  return on_line ? 200 : from_middle < 600 ? 100 : 20;
}

/* The sample at a ray's end lies up to a step before the first whole step of its interval: where it alone meets a bright
 * line, neither it nor its interval may be skipped, at any angle and for any number of samples in an interval. */
TEST(bright_line_at_the_exit) {
  static const double steps[] = {1.3, 1.9, 3.9, 6, 9, 12}; /* with blocks of 2 voxels: 4 samples in an interval to one */
  test_grid grid = {.dims = {61, 53, 67}, .type = TC_U8, .spacing = {1, 1, 1}, .slope = 1};
  g_autoptr(tc_volume) v = test_volume(&grid, lines, &grid);
  g_auto(tc_scene) s;
  test_scene(&s, 96, 96);
  s.mode = TC_MODE_MIP;
  s.skipping.block = 2;
  set_window(&s, 0, 255);
  size_t pixels = 96 * 96, differ[4] = {0}, drawn = 0, apart = 0;
  uint64_t seed = 3, leaps[4] = {0};
  for (int n = 0; n < 24; n++) {
    double side[3] = {test_random(&seed) - 0.5, test_random(&seed) - 0.5, test_random(&seed) - 0.5};
    test_scene_frame(&s, v, n % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
    s.sampling.step = steps[n % 6];
    g_autofree float *first = g_new(float, 4 * pixels), *with = g_new(float, 4 * pixels);
    EACH_RENDERER(i) {
      s.skipping.mode = TC_SKIPPING_AUTO;
      const tc_frame *frame = render(i, v, &s, NULL);
      memcpy(with, frame->linear, 16 * pixels);
      leaps[i] += frame->stats.leaps;
      if (i == 0) memcpy(first, with, 16 * pixels);
      for (size_t p = 0; i == GL && p < pixels; p++)
        apart += fabs((double)with[4 * p] - (double)first[4 * p]) > 1 / 255.0;
      s.skipping.mode = TC_SKIPPING_OFF;
      const float *without = render(i, v, &s, NULL)->linear;
      for (size_t p = 0; p < pixels; p++) differ[i] += memcmp(with + 4 * p, without + 4 * p, 16) != 0;
    }
    drawn += pixels;
  }
  EACH_RENDERER(i)
  printf("  %-6s %zu of %zu pixels differ with skipping, %llu leaps\n", test_names[i], differ[i], drawn,
         (unsigned long long)leaps[i]);
  printf("  gl and scalar are over 1/255 apart in %zu pixels\n", apart);
  EACH_RENDERER(i) {
    assert_int_equal(differ[i], 0);
    assert_true(leaps[i] > 0);
  }
  assert_int_equal(apart, 0);
}

/* Samples two voxels apart along z are all 100, or 0 before the object; greater values lie between: beside the first
 * one, and where the levels promise most. */
static double combs(double x, double y, double z, const void *context) {
  int at = (int)z, first = 30;
  return at < first ? 0 : at == first + 1 ? 200 : at == 71 ? 250 : at % 2 ? 60 : 100;
}

/* Which of equal samples is looked around does not depend on which interval was guessed to be the best. */
TEST(first_of_equals) {
  test_grid grid = {.dims = {8, 8, 96}, .type = TC_U8, .spacing = {1, 1, 1}, .slope = 1};
  g_autoptr(tc_volume) v = test_volume(&grid, combs, NULL);
  g_auto(tc_scene) s;
  test_scene(&s, 24, 24);
  s.mode = TC_MODE_MIP;
  s.sampling.step = 2;
  set_window(&s, 0, 255);
  test_scene_frame(&s, v, TC_ORTHOGRAPHIC, (double[3]){0, 0, -1});
  s.camera.height_mm = 7;
  EACH_RENDERER(i)
  for (int skip = 0; skip < 2; skip++) {
    s.skipping.mode = skip ? TC_SKIPPING_AUTO : TC_SKIPPING_OFF;
    s.skipping.block = 4;
    const tc_frame *f = render(i, v, &s, NULL);
    assert_int_equal(f->stats.leaps > 0, skip);
    for (size_t p = 0; p < 24 * 24; p++)
      if (fabs(255 * (double)f->linear[4 * p] - 200) > 0.01)
        fail_msg("%s, skipping %d: pixel %zu is %g", test_names[i], skip, p, 255 * (double)f->linear[4 * p]);
  }
}

/* An even background with specks little above it, whose levels are in its band, and few bright ones, whose surroundings are
 * sampled first. */
static double specks(double x, double y, double z, const void *context) {
  uint64_t seed = 1 + (uint64_t)(floor(x / 3) + 100 * floor(y / 3) + 10000 * floor(z / 3)) + 1000000 * *(const uint64_t *)context;
  test_random(&seed); /* neighbouring seeds give similar first numbers */
  const double kind = test_random(&seed), most = kind < 0.002 ? 100 : kind < 0.04 ? 9 : 0;
  return 148 + most * test_random(&seed);
}

/* Intervals that rank alike are marched together: rays of one packet that have met specks of different values must still
 * sample every interval that can raise their own maximum. */
TEST(rays_of_a_packet_with_different_maxima) {
  test_grid grid = {.dims = {24, 24, 200}, .type = TC_U8, .spacing = {1, 1, 1}, .slope = 1};
  g_auto(tc_scene) s;
  test_scene(&s, 40, 40);
  s.mode = TC_MODE_MIP;
  s.skipping.block = 4;
  set_window(&s, 0, 255);
  uint64_t leaps[4] = {0};
  for (uint64_t n = 0; n < 8; n++) {
    g_autoptr(tc_volume) v = test_volume(&grid, specks, &n);
    test_scene_frame(&s, v, TC_ORTHOGRAPHIC, (double[3]){0.02 * (double)n, 0.01, -1});
    s.camera.height_mm = 24;
    EACH_RENDERER(i) {
      g_autofree float *with = g_new(float, 4 * 40 * 40);
      s.skipping.mode = TC_SKIPPING_AUTO;
      const tc_frame *frame = render(i, v, &s, NULL);
      leaps[i] += frame->stats.leaps;
      memcpy(with, frame->linear, 16 * 40 * 40);
      s.skipping.mode = TC_SKIPPING_OFF;
      if (memcmp(with, render(i, v, &s, NULL)->linear, 16 * 40 * 40))
        fail_msg("%s: volume %d differs with skipping", test_names[i], (int)n);
    }
  }
  EACH_RENDERER(i) assert_true(leaps[i] > 0);
}

/* On volumes with much between which little is bright it pays: samples as they were measured, with a margin. */
TEST(skipping_pays) {
  const char *data = getenv("TC_DATA");
  char path[512];
  g_autoptr(tc_volume) v = NULL;
  if (data) {
    snprintf(path, sizeof path, "%s/nrrd/aneurism.nrrd", data);
    v = tc_import(path, NULL, NULL);
  }
  bool real = v != NULL;
  if (!v) {
    printf("  TC_DATA is not set: the generated vessels stand in\n");
    v = tc_volume_demo("vessels", NULL);
  }
  g_auto(tc_scene) s;
  tc_scene_init(&s);
  tc_scene_fit(&s, v);
  s.mode = TC_MODE_MIP;
  s.image.width = s.image.height = 200;
  s.skipping.mode = TC_SKIPPING_OFF;
  uint64_t off = render(0, v, &s, NULL)->stats.samples;
  s.skipping.mode = TC_SKIPPING_AUTO;
  tc_explanation plan;
  uint64_t on = render(0, v, &s, &plan)->stats.samples;
  double bytes = (double)plan.stages[TC_STAGE_SKIPPING].bytes / (double)tc_volume_bytes(v);
  printf("  %.3f of the samples, structure %.2f %% of the voxel bytes\n", (double)on / (double)off, 100 * bytes);
  assert_true((double)on < (real ? 0.5 : 1) * (double)off); /* the generated ones are thick and fill their box */
  assert_true(bytes < 0.05); /* of blocks 4 voxels wide: 3 bytes for 64 of a byte each */
  assert_true(render(0, v, &s, NULL)->stats.skip_ms == 0); /* a second frame builds nothing */
}

/* ---- the plan ---- */

TEST(plan_leaves_out) {
  g_autoptr(tc_volume) volume = wave_volume(TC_U16, 1);
  g_auto(tc_scene) scene;
  test_scene(&scene, 16, 16);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0, -1, 0});
  /* Without meaning in these modes, hence no reason to refuse. */
  scene.classification = TC_POST;
  scene.order = TC_BACK_TO_FRONT;
  scene.shading.model = TC_SHADING_GOOCH;
  scene.transfer_function.points[0].value = NAN;
  for (int m = 0; m < 3; m++)
    EACH_RENDERER(i) {
      tc_explanation plan, before;
      char name[64];
      scene.mode = modes[m];
      /* another window, other bounds: nothing of them is there before the first frame */
      scene.window.center = 1234 + m;
      assert_true(tc_renderer_explain(test_renderers[i], volume, &scene, NULL, &before, NULL));
      const tc_frame *frame = render(i, volume, &scene, &plan);
      assert_memory_equal(&plan.key, &before.key, sizeof plan.key);
      snprintf(name, sizeof name, "%s.linear.u16.%s", tc_mode_names[modes[m]], test_names[i]);
      assert_string_equal(plan.kernel, name);
      assert_string_equal(before.kernel, name);
      assert_false(plan.stages[TC_STAGE_TABLE_2D].included || plan.stages[TC_STAGE_TABLE_1D].included ||
                   plan.stages[TC_STAGE_GRADIENT].included || plan.stages[TC_STAGE_TERMINATION].included);
      assert_true(plan.table_size == 0 && plan.stages[TC_STAGE_TABLE_2D].bytes == 0 && frame->stats.tables_ms == 0);
      assert_non_null(strstr(plan.stages[TC_STAGE_TABLE_2D].reason, "window"));
      assert_non_null(strstr(plan.stages[TC_STAGE_RESOLVE].reason, "123"));
      assert_int_equal(plan.stages[TC_STAGE_SKIPPING].included, modes[m] != TC_MODE_AVERAGE);
      assert_int_equal(plan.stages[TC_STAGE_SKIPPING].bytes > 0, modes[m] != TC_MODE_AVERAGE);
      assert_int_equal(frame->stats.leaps > 0 && modes[m] == TC_MODE_AVERAGE, 0);
    }
}

static void expect_refused(const tc_volume *volume, const tc_scene *scene, int code, const char *pointer) {
  GError *error = NULL;
  tc_explanation plan;
  assert_false(tc_explain(volume, scene, 16, 16, &plan, &error));
  assert_int_equal(error->code, code);
  assert_string_equal(tc_error_pointer(error), pointer);
  g_clear_error(&error);
}

TEST(refusals) {
  g_autoptr(tc_volume) volume = wave_volume(TC_U8, 1);
  const double widths[] = {0, -1, NAN, INFINITY}, centers[] = {NAN, -INFINITY};
  for (int m = 0; m < 3; m++) {
    g_auto(tc_scene) scene;
    test_scene(&scene, 16, 16);
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0, -1, 0});
    scene.mode = modes[m];
    for (size_t k = 0; k < G_N_ELEMENTS(widths); k++) {
      scene.window.width = widths[k];
      expect_refused(volume, &scene, TC_ERROR_INVALID, "/window/width");
    }
    scene.window.width = 1;
    for (size_t k = 0; k < G_N_ELEMENTS(centers); k++) {
      scene.window.center = centers[k];
      expect_refused(volume, &scene, TC_ERROR_INVALID, "/window/center");
    }
    scene.window.center = 0;
    scene.filter = TC_FILTER_COUNT;
    expect_refused(volume, &scene, TC_ERROR_INVALID, "/filter");
    scene.filter = TC_FILTER_LINEAR;
    scene.sampling.rays_per_pixel = 65;
    expect_refused(volume, &scene, TC_ERROR_INVALID, "/sampling/raysPerPixel");
    scene.sampling.rays_per_pixel = 1;
    scene.clip.n_planes = 1; /* a normal of zero */
    expect_refused(volume, &scene, TC_ERROR_INVALID, "/clip/planes/0");
    scene.clip.n_planes = 0;
  }
}

TESTS(test_renderers_open, test_renderers_close)
