/* Several rays a pixel, sub-pixel coherence and jitter, on every back end: against closed forms, against the reference
 * averaged over the same rays, and against themselves bit for bit. */
#include "tests/support/test.h"

#include "renderer/raycast/subpixel.h"
#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

static const int counts[] = {1, 2, 4, 5, 8, 16};

static void draw(tc_renderer *r, tc_volume *volume, const tc_scene *scene, tc_frame *frame, tc_explanation *plan) {
  GError *error = NULL;
  const tc_render_request request = {.want_linear = true, .explanation = plan};
  if (!tc_render(r, volume, scene, &request, frame, &error)) fail_msg("%s", error->message);
}

static const tc_frame *render(int m, tc_volume *volume, const tc_scene *scene) {
  return test_draw(m, volume, scene, NULL, NULL);
}

static size_t pixels_of(const tc_scene *scene) { return (size_t)scene->image.width * (size_t)scene->image.height; }

/* The mean of the reference over the given places in every pixel. */
static float *reference_mean(tc_volume *volume, const tc_scene *scene, const tc_subpixel *rays, int count, double tolerance) {
  GError *error = NULL;
  int width = scene->image.width, height = scene->image.height;
  g_autoptr(tc_reference) reference = tc_reference_new(volume, scene, width, height, tolerance, &error);
  float *image = calloc(pixels_of(scene), 4 * sizeof *image);
  if (!reference || !image) fail_msg("reference failed");
  for (int i = 0; i < width * height; i++) {
    double sum[4] = {0};
    for (int r = 0; r < count; r++) {
      double c[4];
      tc_reference_pixel(reference, i % width + 0.5 + rays[r].x, i / width + 0.5 + rays[r].y, c);
      for (int k = 0; k < 4; k++) sum[k] += c[k] / count;
    }
    for (int k = 0; k < 4; k++) image[4 * i + k] = (float)sum[k];
  }
  return image;
}

static tc_volume *waves(tc_voxel_type type) {
  static const double slope[] = {1.0 / 255, 1.0 / 127, 1.0 / 65535, 1.0 / 32767, 0};
  return test_volume(&(test_grid){.dims = {32, 28, 24}, .type = type, .slope = slope[type]}, test_waves, &(double){20});
}

/* ---- the rays of a pixel ---- */

TEST(rays_of_a_pixel) {
  for (int count = 1; count <= TC_MAX_RAYS_PER_PIXEL; count++) {
    tc_subpixel rays[TC_MAX_RAYS_PER_PIXEL];
    uint64_t columns = 0, phases = 0;
    double nearest = 9;
    tc_subpixel_rays(count, rays);
    for (int r = 0; r < count; r++) {
      const tc_subpixel *a = &rays[r], *opposite = &rays[count - 1 - r];
      assert_true(fabs(a->x) < 0.499 && fabs(a->y) < 0.499); /* rounding may not move it into the next pixel */
      assert_true(fabs(a->x + opposite->x) < 1e-12 && fabs(a->y + opposite->y) < 1e-12);
      columns |= (uint64_t)1 << (int)((a->x + 0.5) * count);
      phases |= (uint64_t)1 << ((int)lround(a->phase * count) - 1);
      assert_true(a->phase > 0 && a->phase <= 1);
      for (int s = 0; s < r; s++) nearest = fmin(nearest, hypot(a->x - rays[s].x, a->y - rays[s].y));
    }
    uint64_t all = count == 64 ? ~(uint64_t)0 : ((uint64_t)1 << count) - 1;
    assert_true(columns == all && phases == all);
    if (count > 1) assert_true(nearest > 0.6 / sqrt(count)); /* a square lattice has 1 / sqrt(count) */
  }
}

/* ---- exactness ---- */

/* Alike everywhere: no first, last or only segment of any ray may show, nor the averaging. */
TEST(homogeneous_slab) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {12, 9, 9}, .type = TC_I16}, test_constant, &(double){100});
  double worst = 0;
  for (size_t c = 0; c < G_N_ELEMENTS(counts); c++)
    for (int jitter = 0; jitter < 2; jitter++)
      for (double step = 0.25; step <= 1; step *= 2)
        for (double tau = 1e-10; tau < 2e10; tau *= 30) {
          tc_knot knot = {.value = 0, .color = {1, 0.25, 0}, .amount = tau};
          g_auto(tc_scene) scene;
          test_scene(&scene, 9, 6);
          test_scene_knots(&scene, TC_KNOT_EXTINCTION, &knot, 1);
          test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){-20, 4, 4}, (double[3]){0, 4, 4}, 5);
          scene.sampling.rays_per_pixel = counts[c];
          scene.sampling.jitter = jitter;
          scene.sampling.step = step;
          double alpha = -expm1(-11 * tau), off = 0;
          /* Shorter than one segment, a medium is known by the segment's opacity alone, in single precision. */
          double bound = step * counts[c] <= 11 ? 3e-6 : 1e-5;
          EACH_RENDERER(m) {
            const tc_frame *f = render(m, volume, &scene);
            for (size_t i = 0; i < pixels_of(&scene); i++) {
              const float *p = f->linear + 4 * i;
              off = fmax(fmax(fabs(p[3] - alpha), fabs(p[0] - alpha)), fabs(p[1] - 0.25 * alpha));
              if (!(off <= bound))
                fail_msg("%s: %d rays, jitter %d, step %g, tau*d %g: off by %g", test_names[m], counts[c], jitter, step,
                         11 * tau, off);
              worst = fmax(worst, off);
            }
          }
        }
  printf("  homogeneous slab: off by at most %.1e\n", worst);
}

/* As dense as a quarter of a voxel along every ray: what is left is the error of one such ray
 * (accuracy/test_raycast). */
TEST(against_the_same_rays) {
  for (int type = TC_U8; type <= TC_U16; type += TC_U16 - TC_U8) {
    g_autoptr(tc_volume) volume = waves((tc_voxel_type)type);
    for (size_t c = 0; c < G_N_ELEMENTS(counts); c++) {
      tc_subpixel rays[TC_MAX_RAYS_PER_PIXEL];
      g_auto(tc_scene) scene;
      test_scene(&scene, 28, 22);
      test_scene_knots(&scene, TC_KNOT_EXTINCTION, test_soft, G_N_ELEMENTS(test_soft));
      test_scene_frame(&scene, volume, type ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, (double[3]){0.8, -1.5, 0.6});
      scene.sampling.rays_per_pixel = counts[c];
      scene.sampling.step = 0.25 / counts[c];
      tc_subpixel_rays(counts[c], rays);
      g_autofree float *want = reference_mean(volume, &scene, rays, counts[c], 1e-7);
      for (int jitter = 0; jitter < 2; jitter++)
        EACH_RENDERER(m) {
          scene.sampling.jitter = jitter;
          test_difference d = test_compare(render(m, volume, &scene)->linear, want, pixels_of(&scene));
          char line[80];
          snprintf(line, sizeof line, "%s, %d rays%s, %s", tc_voxel_type_name((tc_voxel_type)type), counts[c],
                   jitter ? ", jitter" : "", test_names[m]);
          if (m == 0) test_print_difference(line, &d, scene.image.width);
          if (!d.finite || !(d.rms <= 1.1e-4) || !(d.max <= 2.5e-3) || !(fabs(d.mean) <= 3e-5))
            fail_msg("%s: rms %g, max %g, mean %g", line, d.rms, d.max, d.mean);
        }
    }
  }
}

/* One ray's samples, shared by more: the edges inside a pixel are seen for about the same number of samples. */
TEST(smooth_edges_cost_nothing) {
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {33, 33, 33}, .type = TC_F32}, test_radius2, (double[3]){16, 16, 16});
  tc_knot knots[] = {{.value = 121, .color = {1, 0.6, 0.1}, .amount = 1},
                     {.value = 121, .color = {1, 0.6, 0.1}, .amount = 0}};
  tc_subpixel fine[TC_MAX_RAYS_PER_PIXEL];
  g_auto(tc_scene) scene;
  test_scene(&scene, 26, 26);
  test_scene_knots(&scene, TC_KNOT_EXTINCTION, knots, 2);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.4, -1, 0.3});
  scene.sampling.step = 0.125;
  scene.skipping.mode = TC_SKIPPING_OFF;
  tc_subpixel_rays(64, fine);
  g_autofree float *want = reference_mean(volume, &scene, fine, 64, 1e-7);
  double one = 0, samples = 0;
  for (size_t c = 0; c < G_N_ELEMENTS(counts); c++) {
    scene.sampling.rays_per_pixel = counts[c];
    const tc_frame *f = render(0, volume, &scene);
    test_difference d = test_compare(f->linear, want, pixels_of(&scene));
    printf("  %2d rays: rms %.4f of the pixels' areas, %llu rays, %llu samples\n", counts[c], d.rms,
           (unsigned long long)f->stats.rays, (unsigned long long)f->stats.samples);
    if (c == 0) one = d.rms, samples = (double)f->stats.samples;
    /* more by a ray's first sample and its end */
    assert_true((double)f->stats.samples < samples * (1 + 0.02 * counts[c]));
    if (counts[c] > 1) assert_true(d.rms < one / sqrt(counts[c]));
  }
}

TEST(projections_average_whole_rays) {
  g_autoptr(tc_volume) volume = waves(TC_U16);
  static const tc_mode modes[] = {TC_MODE_MIP, TC_MODE_MINIP, TC_MODE_AVERAGE};
  for (size_t i = 0; i < G_N_ELEMENTS(modes); i++)
    for (int count = 4; count <= 5; count++) {
      tc_subpixel rays[TC_MAX_RAYS_PER_PIXEL];
      g_auto(tc_scene) scene;
      test_scene(&scene, 24, 20);
      test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.8, -1.5, 0.6});
      scene.mode = modes[i];
      scene.window.center = 0.5, scene.window.width = 1;
      scene.sampling.rays_per_pixel = count;
      scene.sampling.step = 0.1;
      tc_subpixel_rays(count, rays);
      g_autofree float *want = reference_mean(volume, &scene, rays, count, 1e-7);
      EACH_RENDERER(m) {
        test_difference d = test_compare(render(m, volume, &scene)->linear, want, pixels_of(&scene));
        if (!(d.max <= 6e-4))
          fail_msg("%s, mode %d, %d rays: max %g at %zu", test_names[m], modes[i], count, d.max, d.worst);
        if (m == 0) printf("  mode %d, %d rays: max %.1e\n", modes[i], count, d.max);
      }
    }
}

/* ---- wood grain ---- */

/* References of whole pictures take long under a checker, which has seen all there is after one. */
enum { MOST_DEMOS = SANITIZED ? 1 : 9 };

/* Mean of channel k of a - b over the pixels within r of (x, y). */
static double mean_around(const float *a, const float *b, int width, int x, int y, int r, int k) {
  double sum = 0;
  for (int j = y - r; j <= y + r; j++)
    for (int i = x - r; i <= x + r; i++) {
      size_t at = 4 * ((size_t)j * (size_t)width + (size_t)i) + (size_t)k;
      sum += (double)a[at] - b[at];
    }
  return sum / ((2 * r + 1) * (2 * r + 1));
}

/* Rings in an error: root mean square of what means over 3x3 pixels keep and means over 15x15 do not. Noise that is
 * even among neighbours is gone from the first, a smooth error is in both. */
static double rings_of(const float *a, const float *b, int width, int height) {
  double sum = 0;
  for (int y = 7; y < height - 7; y++)
    for (int x = 7; x < width - 7; x++)
      for (int k = 0; k < 3; k++) {
        double d = mean_around(a, b, width, x, y, 1, k) - mean_around(a, b, width, x, y, 7, k);
        sum += d * d;
      }
  return sqrt(sum / (3.0 * (width - 14) * (height - 14)));
}

static void rings_at(double step, tc_volume *volume, tc_scene *scene, const float *want, double rings[2],
                     double mean[2]) {
  scene->sampling.step = step;
  for (int jitter = 0; jitter < 2; jitter++) {
    scene->sampling.jitter = jitter;
    const tc_frame *f = render(test_widest(), volume, scene);
    rings[jitter] = rings_of(f->linear, want, scene->image.width, scene->image.height);
    mean[jitter] = test_compare(f->linear, want, pixels_of(scene)).mean;
  }
  scene->sampling.jitter = false;
}

/* A demo as it is first shown, but seen obliquely: along an axis, steps of a voxel are cells of the grid and too good
 * an example. */
static tc_volume *show_demo(const char *name, int side, tc_scene *scene) {
  tc_volume *volume = tc_volume_demo(name, NULL);
  tc_scene_init(scene);
  tc_scene_fit(scene, volume);
  scene->image.width = scene->image.height = side;
  test_scene_frame(scene, volume, TC_PERSPECTIVE, (double[3]){0.5, -1, 0.4});
  return volume;
}

/* No rings at the default of a voxel (bound, of 1/255, without jitter), and jitter moves no light. */
TEST(no_rings_by_default) {
  static const struct { const char *name; double bound; } demos[] = {
      {"bucky", 0.05}, {"marschner-lobb", 0.4}, {"head", 0.2}, {"vessels", 0.8}};
  for (size_t i = 0; i < G_N_ELEMENTS(demos) && i < MOST_DEMOS; i++) {
    g_auto(tc_scene) scene;
    g_autoptr(tc_volume) volume = show_demo(demos[i].name, SANITIZED ? 48 : 96, &scene);
    double rings[2], mean[2];
    g_autofree float *want = reference_mean(volume, &scene, &(tc_subpixel){0}, 1, 1e-5);
    rings_at(1, volume, &scene, want, rings, mean);
    printf("  %-15s rings %.3f/255, with jitter %.3f/255; mean error %.3f/255 and %.3f/255\n", demos[i].name,
           255 * rings[0], 255 * rings[1], 255 * mean[0], 255 * mean[1]);
    assert_true(rings[0] < demos[i].bound / 255 && rings[1] < demos[i].bound / 255);
    assert_true(fabs(mean[0] - mean[1]) < 0.02 / 255);
  }
}

/* The same of lit surfaces, by each kind of gradient: a highlight shows what its normals do. None on what is smooth;
 * marschner-lobb has waves of three voxels. Bounds: at most 1.5 times the rings measured in the larger pictures, of the ones with
 * jitter and without. References of wide gradients take longest: without TC_LONG only the first demo takes cubic ones, and
 * marschner-lobb takes those of a cell alone. */
TEST(no_rings_on_lit_surfaces) {
  static const struct { const char *name; double bounds[TC_GRADIENT_COUNT]; } demos[] = {
      {"bucky", {0.28, 0.041, 0.039}}, {"marschner-lobb", {5.4, 3.5, 3.5}}, {"head", {1.2, 0.32, 0.28}}};
  for (size_t i = 0; i < G_N_ELEMENTS(demos) && i < MOST_DEMOS; i++) {
    g_auto(tc_scene) scene;
    g_autoptr(tc_volume) volume = show_demo(demos[i].name, SANITIZED ? 48 : 64, &scene);
    double rings[2], mean[2];
    scene.shading.model = TC_SHADING_BLINN_PHONG;
    for (int gradient = 0; gradient < TC_GRADIENT_COUNT; gradient++) {
      const bool slow = gradient == TC_GRADIENT_CUBIC ? SANITIZED || i > 0 : gradient == TC_GRADIENT_CENTRAL && i == 1;
      if (slow && !getenv("TC_LONG")) continue;
      scene.shading.gradient = (tc_gradient)gradient;
      g_autofree float *want = reference_mean(volume, &scene, &(tc_subpixel){0}, 1, 1e-5);
      rings_at(1, volume, &scene, want, rings, mean);
      printf("  %-15s %-8s rings %.3f/255, with jitter %.3f/255; mean error %.3f/255\n", demos[i].name,
             tc_gradient_names[gradient], 255 * rings[0], 255 * rings[1], 255 * mean[0]);
      assert_true(rings[0] < demos[i].bounds[gradient] / 255 && rings[1] < demos[i].bounds[gradient] / 255);
    }
  }
}

/* The classical case, long steps from a plane through a shell that the transfer function cuts out of a smooth field.
 * Rings are what depends on where the steps begin: the difference to the mean over planes that lie fractions of a step
 * apart, in empty space. */
TEST(jitter_takes_rings_away) {
  enum { PHASES = 16, SIDE = 128 };
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {65, 65, 65}, .type = TC_F32}, test_radius2, (double[3]){32, 32, 32});
  tc_knot knots[] = {{400, {1, 0.6, 0.1}, 0}, {425, {1, 0.9, 0.3}, 0.1}, {450, {0.2, 0.3, 1}, 0}};
  g_auto(tc_scene) scene;
  test_scene(&scene, SIDE, SIDE);
  test_scene_knots(&scene, TC_KNOT_EXTINCTION, knots, 3);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){32, -50, 32}, (double[3]){32, 32, 32}, 44);
  scene.clip.n_planes = 1;
  scene.clip.planes[0][1] = 1;
  g_autofree float *mean = calloc(pixels_of(&scene), 4 * sizeof *mean);
  for (scene.sampling.step = 2; scene.sampling.step <= 4; scene.sampling.step *= 2) {
    double rings[2];
    memset(mean, 0, 16 * pixels_of(&scene));
    for (int phase = PHASES; phase-- > 0;) {
      scene.clip.planes[0][3] = -1 - scene.sampling.step * phase / PHASES;
      const tc_frame *f = render(test_widest(), volume, &scene);
      for (size_t i = 0; i < 4 * pixels_of(&scene); i++) mean[i] += f->linear[i] / PHASES;
    }
    for (int jitter = 0; jitter < 2; jitter++) {
      scene.sampling.jitter = jitter;
      rings[jitter] = rings_of(render(test_widest(), volume, &scene)->linear, mean, SIDE, SIDE);
    }
    scene.sampling.jitter = false;
    printf("  shell, step %g: rings %.3f/255, with jitter %.3f/255\n", scene.sampling.step, 255 * rings[0],
           255 * rings[1]);
    /* nine pixels hold nine phases: of the longer steps' larger differences they leave more */
    assert_true(rings[0] > 0.1 / 255 && rings[1] < (scene.sampling.step > 2 ? 0.8 : 0.4) * rings[0]);
  }
}

/* ---- coherence ---- */

/* Single bright voxels far apart, some balls: features that rays beside a pixel's middle meet and the middle does
 * not. */
typedef struct specks { unsigned seed; double share; } specks;
static double speck_field(double x, double y, double z, const void *context) {
  const specks *s = context;
  double far = (x - 30) * (x - 30) + (y - 25) * (y - 25) + (z - 20) * (z - 20);
  return test_noise(x, y, z, &s->seed) < s->share || far < 16 ? 200 : 0;
}

typedef struct saving { uint64_t with, without, leaps_with, leaps_without; int shared, plain; } saving;

static void random_specks(tc_scene *scene, uint64_t *state, int trial, tc_volume **volume) {
  static const double shares[] = {0, 1e-4, 3e-4, 2e-3};
  specks s = {(unsigned)(trial + 1), shares[trial % 4]};
  test_grid grid = {.type = (tc_voxel_type)(trial % TC_VOXEL_TYPE_COUNT), .slope = 2};
  for (int k = 0; k < 3; k++) {
    grid.dims[k] = 1 + (int)(70 * test_random(state));
    grid.spacing[k] = 0.5 + test_random(state);
  }
  *volume = test_volume(&grid, speck_field, &s);
  const tc_knot knots[] = {{60, {1, 0.5, 0.2}, 0}, {200, {1, 0.9, 0.8}, 0.9}};
  test_scene(scene, 9 + (int)(60 * test_random(state)), 8 + (int)(50 * test_random(state)));
  test_scene_knots(scene, TC_KNOT_OPACITY, knots, 2);
  double side[3];
  for (int k = 0; k < 3; k++) side[k] = trial % 7 == k ? 0 : test_random(state) - 0.5;
  test_scene_frame(scene, *volume, trial % 2 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
  if (trial % 5 == 0) /* the eye near or inside */
    for (int k = 0; k < 3; k++)
      scene->camera.position[k] +=
          (0.5 + 0.6 * test_random(state)) * (scene->camera.target[k] - scene->camera.position[k]);
  if (trial % 3 == 0) {
    double *p = scene->clip.planes[scene->clip.n_planes++];
    for (int k = 0; k < 3; k++) p[k] = test_random(state) - 0.5;
    p[3] = -(p[0] * scene->camera.target[0] + p[1] * scene->camera.target[1] + p[2] * scene->camera.target[2]) + 3;
  }
  scene->sampling.rays_per_pixel = counts[1 + trial % 5];
  scene->sampling.step = 0.1 + 0.4 * test_random(state);
  scene->sampling.jitter = trial % 4 == 1;
  scene->sampling.termination = trial % 2 ? 0.01 : 0;
  scene->shading.model = trial % 6 == 2 ? TC_SHADING_LAMBERT : TC_SHADING_NONE;
  scene->skipping.block = trial % 8 ? 2 + (int)(8 * test_random(state)) : 0;
}

/* Bit for bit, with leaping and coherence, with leaping alone, and with neither. */
static void check_trial(int m, int trial, tc_volume *volume, tc_scene *scene, saving *sum) {
  tc_explanation plan;
  g_auto(tc_frame) shared = {0}, alone = {0};
  scene->sampling.coherence = true;
  draw(test_renderers[m], volume, scene, &shared, &plan);
  sum->shared += plan.stages[TC_STAGE_COHERENCE].included;
  sum->plain += !plan.stages[TC_STAGE_COHERENCE].included;
  assert_int_equal(plan.stages[TC_STAGE_COHERENCE].included, plan.key.coherence);
  scene->sampling.coherence = false;
  for (int off = 0; off < 2; off++) {
    scene->skipping.mode = off ? TC_SKIPPING_OFF : TC_SKIPPING_AUTO;
    draw(test_renderers[m], volume, scene, &alone, NULL);
    for (size_t i = 0; i < 4 * pixels_of(scene); i++)
      if (shared.linear[i] != alone.linear[i])
        fail_msg("%s, trial %d: pixel %zu is %g with coherence and %g without%s (%s)", test_names[m], trial, i / 4,
                 shared.linear[i], alone.linear[i], off ? " leaping" : "", plan.stages[TC_STAGE_COHERENCE].reason);
    if (off || !plan.key.coherence) continue;
    sum->with += shared.stats.samples, sum->without += alone.stats.samples;
    sum->leaps_with += shared.stats.leaps, sum->leaps_without += alone.stats.leaps;
  }
  scene->skipping.mode = TC_SKIPPING_AUTO;
}

TEST(coherence_loses_nothing) {
  EACH_RENDERER(m) {
    int trials = m < GL ? 80 : 12;
    uint64_t random = 2024;
    saving sum = {0};
    for (int trial = 0; trial < trials; trial++) {
      tc_volume *volume;
      g_auto(tc_scene) scene;
      random_specks(&scene, &random, trial, &volume);
      check_trial(m, trial, volume, &scene, &sum);
      tc_volume_unref(volume);
    }
    printf("  %s: %d scenes shared, %d not; %.2f of the samples and %.2f of the leaps left\n", test_names[m],
           sum.shared, sum.plain, (double)sum.with / (double)sum.without,
           (double)sum.leaps_with / (double)sum.leaps_without);
    assert_true(sum.shared > trials / 3 && sum.plain > 0);
    if (m < GL) /* rays of a pixel always share the runs of what shows (skip/cover.h) */
      assert_true(sum.with == sum.without && sum.leaps_with == sum.leaps_without);
    else
      assert_true(sum.with < sum.without && sum.leaps_with < sum.leaps_without);
  }
}

TEST(the_plan_says_why) {
  g_autoptr(tc_volume) volume = tc_volume_demo("vessels", NULL);
  g_auto(tc_scene) scene;
  tc_explanation plan;
  const tc_knot full[] = {{0, {1, 1, 1}, 0.001}}, part[] = {{80, {1, 1, 1}, 0}, {255, {1, 1, 1}, 0.5}};
  test_scene(&scene, 64, 64);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0, -1, 0});
  scene.sampling.coherence = true;
#define COHERENT(change, wanted, part_of_reason)                                                                     \
  do {                                                                                                               \
    change;                                                                                                          \
    assert_true(tc_explain(volume, &scene, scene.image.width, scene.image.height, &plan, NULL));                   \
    assert_int_equal(plan.key.coherence, wanted);                                                                    \
    assert_int_equal(plan.stages[TC_STAGE_COHERENCE].included, wanted);                                              \
    if (!strstr(plan.stages[TC_STAGE_COHERENCE].reason, part_of_reason))                                             \
      fail_msg("\"%s\" lacks \"%s\"", plan.stages[TC_STAGE_COHERENCE].reason, part_of_reason);                       \
  } while (0)
  COHERENT(test_scene_knots(&scene, TC_KNOT_OPACITY, part, 2), false, "one ray per pixel");
  assert_false(plan.key.rays || plan.stages[TC_STAGE_RAYS].included);
  COHERENT(scene.sampling.rays_per_pixel = 4, true, "voxels around");
  assert_true(plan.key.rays && plan.stages[TC_STAGE_RAYS].included);
  const double *spacing = tc_volume_describe(volume)->spacing;
  assert_true(fabs(plan.step_mm - 4 * fmin(spacing[0], fmin(spacing[1], spacing[2]))) < 1e-12);
  COHERENT(scene.skipping.mode = TC_SKIPPING_OFF, false, "skipping is off");
  COHERENT(scene.skipping.mode = TC_SKIPPING_AUTO, true, "voxels around");
  COHERENT(scene.image.width = scene.image.height = 6, false, "more than");
  COHERENT((scene.image.width = scene.image.height = 64, scene.camera.fov_y_deg = 179), false, "more than");
  COHERENT(test_scene_frame(&scene, volume, TC_ORTHOGRAPHIC, (double[3]){0, -1, 0}), true, "voxels around");
  COHERENT(scene.mode = TC_MODE_MIP, false, "no empty space");
  COHERENT((scene.mode = TC_MODE_DVR, scene.sampling.coherence = false), false, "is off");
  scene.sampling.coherence = scene.sampling.jitter = true;
  COHERENT(test_scene_knots(&scene, TC_KNOT_OPACITY, full, 1), false, "skipping is off");
  assert_true(plan.key.jitter && plan.stages[TC_STAGE_JITTER].included);
  COHERENT((scene.mode = TC_MODE_MIP, scene.window.width = 1), false, "no empty space");
  assert_false(plan.key.jitter || plan.stages[TC_STAGE_JITTER].included);
}

/* ---- back ends and threads ---- */

/* NUMERICS section 5: within 1/255 of each other. */
TEST(back_ends_agree) {
  for (size_t c = 0; c < G_N_ELEMENTS(counts); c++)
    for (int bits = 0; bits < 8; bits++) {
      g_autoptr(tc_volume) volume = waves(TC_U8);
      g_auto(tc_scene) scene;
      test_scene(&scene, 60, 46);
      test_scene_knots(&scene, TC_KNOT_EXTINCTION, test_soft, G_N_ELEMENTS(test_soft));
      test_scene_frame(&scene, volume, bits & 1 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, (double[3]){0.8, -1.5, 0.6});
      scene.sampling.rays_per_pixel = counts[c];
      scene.sampling.jitter = bits & 2;
      scene.sampling.coherence = bits & 1;
      scene.sampling.termination = bits & 4 ? 0.01 : 0;
      scene.shading.model = bits & 4 ? TC_SHADING_BLINN_PHONG : TC_SHADING_NONE;
      EACH_RENDERER(m) {
        const tc_frame *f = render(m, volume, &scene);
        test_difference d = test_compare(f->linear, test_frames[0].linear, pixels_of(&scene));
        double allowed = m == GL ? 1.0 / 255 : scene.shading.model ? 1e-3 : 1e-4;
        if (!d.finite || d.max > allowed || f->stats.rays != test_frames[0].stats.rays)
          fail_msg("%s, %d rays, case %d: off by %g at %zu; %llu rays and %llu", test_names[m], counts[c], bits, d.max,
                   d.worst, (unsigned long long)f->stats.rays, (unsigned long long)test_frames[0].stats.rays);
      }
    }
}

/* The same bytes for any number of threads, and again: nothing crawls while nothing moves. */
TEST(threads_make_no_difference) {
  g_autoptr(tc_volume) volume = waves(TC_I16);
  tc_renderer *others[] = {tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 1}, NULL),
                           tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 7}, NULL)};
  for (int bits = 0; bits < 16; bits++) {
    g_auto(tc_scene) scene;
    g_auto(tc_frame) first = {0}, again = {0};
    test_scene(&scene, 101, 77);
    test_scene_knots(&scene, TC_KNOT_EXTINCTION, test_soft, G_N_ELEMENTS(test_soft));
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){0.8, -1.5, 0.6});
    scene.mode = bits >> 2 == 3 ? TC_MODE_MIP : TC_MODE_DVR;
    scene.window.center = 0.5, scene.window.width = 1;
    scene.sampling.rays_per_pixel = bits & 1 ? 5 : 1;
    scene.sampling.jitter = bits & 2;
    scene.sampling.coherence = bits & 4;
    scene.shading.model = bits & 8 ? TC_SHADING_LAMBERT : TC_SHADING_NONE;
    draw(others[0], volume, &scene, &first, NULL);
    for (int turn = 0; turn < 4; turn++) {
      draw(others[turn % 2], volume, &scene, &again, NULL);
      assert_memory_equal(first.rgba, again.rgba, 4 * pixels_of(&scene));
      assert_memory_equal(first.linear, again.linear, 16 * pixels_of(&scene));
    }
  }
  tc_renderer_free(others[0]);
  tc_renderer_free(others[1]);
}

TESTS(test_renderers_open, test_renderers_close)
