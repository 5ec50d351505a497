/* The error meter: which pixels it takes, what it finds, how often its interval holds. Errors are printed as
 * numbers. */
#include "tests/support/test.h"

#include "renderer/quality/meter.h"
#include "renderer/quality/quality.h"
#include "renderer/raycast/subpixel.h"
#include "renderer/reference/reference.h"
#include "tests/support/grid.h"

enum { WIDTH = 72, HEIGHT = 48, PIXELS = WIDTH * HEIGHT };

static tc_volume *volume;
static tc_renderer *renderer;
static tc_scene scene;
static tc_frame frame;
static double squares[PIXELS], frame_rms, frame_max; /* of `frame`, from every pixel */

static void render(void) {
  GError *error = NULL;
  if (!tc_render(renderer, volume, &scene, &(tc_render_request){.want_linear = true}, &frame, &error))
    fail_msg("%s", error->message);
}

static int set_up(void **state) {
  GError *error = NULL;
  volume = tc_import("demo:bucky", NULL, &error);
  renderer = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 2}, &error);
  if (!volume || !renderer) return 1;
  tc_scene_init(&scene);
  tc_scene_fit(&scene, volume);
  scene.image.width = WIDTH, scene.image.height = HEIGHT;
  scene.image.background[1] = 0.5;
  scene.sampling.step = 1;
  render();
  g_autoptr(tc_reference) reference = tc_reference_new(volume, &scene, WIDTH, HEIGHT, 1e-8, &error);
  if (!reference) return 1;
  double sum = 0;
  for (int i = 0; i < PIXELS; i++) {
    double wanted[4], got[4];
    tc_reference_pixel(reference, i % WIDTH + 0.5, i / WIDTH + 0.5, wanted);
    for (int c = 0; c < 4; c++)
      got[c] = (double)frame.linear[4 * i + c];
    sum += squares[i] = tc_meter_square(&scene, got, wanted, &frame_max);
  }
  frame_rms = sqrt(sum / PIXELS);
  return 0;
}

static int tear_down(void **state) {
  tc_frame_finish(&frame);
  tc_scene_clear(&scene);
  tc_renderer_free(renderer);
  tc_volume_unref(volume);
  return 0;
}

static tc_meter_result measure(int count, uint64_t seed) {
  GError *error = NULL;
  tc_meter_result result;
  tc_meter *meter = tc_meter_new(&frame, count, seed);
  assert_non_null(meter);
  if (!tc_meter_measure(meter, &(tc_meter_subject){.volume = volume, .scene = &scene}, 0, &result, &error))
    fail_msg("%s", error->message);
  tc_meter_free(meter);
  return result;
}

TEST(all_pixels_give_the_frame_itself) {
  tc_meter_result all = measure(PIXELS + 5, 1);
  assert_int_equal(all.pixels, PIXELS);
  assert_true(frame_rms > 1e-5);
  assert_float_equal(all.rms, frame_rms, 1e-6 * frame_rms + 1e-9);
  assert_float_equal(all.max, frame_max, 1e-6);
  assert_true(all.low < all.rms && all.rms < all.high);
}

/* 95 % nominal; squares are skewed, and a sample that missed the worst pixels is too sure: 88 % is asked here. */
TEST(the_interval_holds_the_truth) {
  enum { SEEDS = 60, COUNT = 256 };
  int held = 0, below = 0;
  double mean = 0;
  for (int i = 0; i < SEEDS; i++) {
    tc_meter_result r = measure(COUNT, (uint64_t)i);
    assert_int_equal(r.pixels, COUNT);
    assert_true(r.max <= frame_max * 1.000001);
    held += r.low <= frame_rms && frame_rms <= r.high;
    below += r.rms < frame_rms;
    mean += r.rms * r.rms / SEEDS;
  }
  printf("  frame rms %.3g, mean of %d meters %.3g; the interval held it %d times, %d were below\n", frame_rms, SEEDS,
         sqrt(mean), held, below);
  assert_true(held >= SEEDS * 88 / 100);
  assert_float_equal(sqrt(mean), frame_rms, 0.1 * frame_rms); /* unbiased */
}

TEST(one_seed_one_answer) {
  tc_meter_result a = measure(64, 7), b = measure(64, 7), c = measure(64, 8);
  assert_true(a.rms == b.rms && a.max == b.max && a.low == b.low);
  assert_true(a.rms != c.rms);
}

/* What the estimator makes of squares that are known: one in four pixels wrong by 0.1. */
TEST(the_estimate_is_the_textbooks) {
  enum { COUNT = 48 };
  double known[COUNT];
  for (int i = 0; i < COUNT; i++)
    known[i] = i % 4 ? 0 : 0.01;
  tc_meter_result r;
  tc_meter_estimate(known, COUNT, &r);
  assert_float_equal(r.rms, 0.05, 1e-12);
  assert_true(r.low > 0.03 && r.low < 0.045 && r.high > 0.055 && r.high < 0.08);
  tc_meter_estimate((double[]){0, 0, 0}, 3, &r);
  assert_true(r.rms == 0 && r.low == 0 && r.high == 0);
  tc_meter_estimate((double[]){0.04}, 1, &r);
  assert_true(r.low == 0 && r.high == 1 && fabs(r.rms - 0.2) < 1e-12);
}

TEST(ends_when_told) {
  atomic_bool cancel = true;
  GError *error = NULL;
  tc_meter_result r;
  tc_meter *meter = tc_meter_new(&frame, 64, 1);
  tc_meter_subject of = {.volume = volume, .scene = &scene, .cancel = &cancel};
  assert_false(tc_meter_measure(meter, &of, 0, &r, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED));
  g_clear_error(&error);
  of.cancel = NULL;
  assert_true(tc_meter_measure(meter, &of, 1e-9, &r, &error)); /* out of time: what there is */
  assert_true(r.pixels >= 1 && r.pixels < 64);
  tc_meter_free(meter);
}

TEST(what_has_no_reference_is_said) {
  char reason[96];
  tc_explanation plan;
  scene.error_meter.pixels = 64;
  assert_false(tc_meter_refuses(&scene, reason, sizeof reason));
  assert_true(tc_explain(volume, &scene, WIDTH, HEIGHT, &plan, NULL));
  assert_true(plan.stages[TC_STAGE_ERROR_METER].included);
  scene.mode = TC_MODE_MPR;
  assert_true(tc_meter_refuses(&scene, reason, sizeof reason));
  assert_true(tc_explain(volume, &scene, WIDTH, HEIGHT, &plan, NULL));
  assert_false(plan.stages[TC_STAGE_ERROR_METER].included);
  assert_string_equal(plan.stages[TC_STAGE_ERROR_METER].reason, reason);
  tc_mesh_surface surface = {.source = TC_SURFACE_OF_VALUE, .opacity = 1, .visible = true};
  tc_scene listed = scene; /* borrows */
  listed.mesh.surfaces = &surface, listed.mesh.n_surfaces = 1;
  for (tc_mode mode = 0; mode < TC_MODE_COUNT; mode++) {
    listed.mode = mode;
    for (int within = 0; within < 2; within++) {
      listed.mesh.with_volume = within;
      assert_false(tc_meter_refuses(&listed, reason, sizeof reason) && strstr(reason, "mesh/"));
    }
  }
  /* A bound on the error is measured without meshes: refused, and said, where the volume has some in it. */
  listed.mode = TC_MODE_DVR, listed.mesh.with_volume = true, listed.quality.max_error = 0.01;
  assert_false(tc_quality_refuses(&listed, reason, sizeof reason));
  surface.source = TC_SURFACE_OF_LABEL, surface.label = 1;
  assert_true(tc_quality_refuses(&listed, reason, sizeof reason) && strstr(reason, "labels and meshes"));
  listed.mesh.with_volume = false;
  assert_false(tc_quality_refuses(&listed, reason, sizeof reason));
  scene.mode = TC_MODE_DVR;
  scene.error_meter.pixels = 0;
}

/* ---- how far a surface is off ---- */

static tc_meter_result surface_measured(const tc_frame *frame, const tc_scene *s) {
  GError *error = NULL;
  tc_meter_result found;
  tc_meter *meter = tc_meter_new(frame, WIDTH * HEIGHT, 1);
  if (!tc_meter_measure(meter, &(tc_meter_subject){.volume = volume, .scene = s}, 0, &found, &error))
    fail_msg("%s", error->message);
  tc_meter_free(meter);
  return found;
}

/* Of every pixel: what is drawn, the same a quarter of a millimetre further off, and without some of it. */
TEST(depths_and_outlines_are_measured) {
  tc_scene s = scene; /* borrows */
  s.isosurface.value = s.window.center;
  s.sampling.step = 0.125;
  for (int m = 0; m < 4; m++) {
    s.mode = m % 2 ? TC_MODE_MESH : TC_MODE_ISOSURFACE, s.sampling.rays_per_pixel = m < 2 ? 1 : 4;
    GError *error = NULL;
    g_auto(tc_frame) drawn = {0};
    const tc_render_request request = {.want_linear = true, .want_depth = true};
    if (!tc_render(renderer, volume, &s, &request, &drawn, &error)) fail_msg("%s", error->message);
    const tc_depth_error as_drawn = surface_measured(&drawn, &s).depth;
    int gone = 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++) drawn.depth[i] += 0.25f;
    const tc_depth_error moved = surface_measured(&drawn, &s).depth;
    for (int i = 0; i < WIDTH * HEIGHT && gone < 50; i++)
      if (isfinite(drawn.depth[i])) drawn.depth[i] = INFINITY, gone++;
    const tc_depth_error cut = surface_measured(&drawn, &s).depth;
    printf("  %s, %d rays: depth %.1e mm rms, 99 %% within %.1e, all within %.1e, of %d pixels; %d at the outline; 0.25 mm off: %.4f (%.4f)\n",
           tc_mode_names[s.mode], s.sampling.rays_per_pixel, as_drawn.rms, as_drawn.p99, as_drawn.max, as_drawn.both, as_drawn.one,
           moved.rms, moved.p50);
    assert_true(as_drawn.both > 200 && as_drawn.p50 <= as_drawn.p99 && as_drawn.p99 <= as_drawn.max);
    assert_true(as_drawn.p50 < 0.02 && as_drawn.p99 < (m == 3 ? 0.6 : 0.3)); /* of four rays one that misses an edge is enough */
    assert_true(moved.rms - 0.25 <= as_drawn.rms + 1e-6); /* the triangle inequality of rms */
    assert_true(moved.rms > 0.25 - as_drawn.rms - 1e-6);
    assert_true(fabs(moved.p50 - 0.25) < 0.01 + as_drawn.p50);
    assert_true(moved.both == as_drawn.both && moved.one == as_drawn.one);
    assert_true(abs(cut.one - as_drawn.one) <= gone && cut.both >= as_drawn.both - gone && cut.both < as_drawn.both);
    assert_int_equal(cut.both + cut.one, as_drawn.both + as_drawn.one);
    assert_true(fabs(cut.outline - (double)cut.one / PIXELS) < 1e-12);
  }
}

/* By hand: pixels 1 .. 100 of surface 0 are so many mm off, 5 of surface 2 are exact, one is missing; one is too much. */
TEST(depth_errors_are_the_textbooks) {
  enum { N = 110 };
  tc_depths pixels[N];
  tc_depth_error all, each[2];
  for (int i = 0; i < N; i++) pixels[i] = (tc_depths){INFINITY, INFINITY, 0, 0}; /* nothing */
  for (int i = 0; i < 100; i++) pixels[i] = (tc_depths){1000 + (i % 2 ? i + 1 : -i - 1), 1000, 0, 0};
  for (int i = 100; i < 106; i++) pixels[i] = (tc_depths){i < 105 ? 7 : INFINITY, 7, 2, 9};
  pixels[106].drawn = 5;
  assert_int_equal(tc_depths_compare(pixels, N, &all, each, 2), 2);
  assert_true(all.both == 105 && all.one == 2 && fabs(all.outline - 2.0 / N) < 1e-12 && all.max == 100);
  assert_float_equal(all.rms, sqrt(338350.0 / 105), 1e-9);
  assert_true(each[0].surface == 0 && each[0].both == 100 && each[0].one == 0 && each[0].p50 == 50 && each[0].p99 == 99);
  assert_float_equal(each[0].rms, sqrt(3383.5), 1e-9);
  assert_true(each[1].surface == 2 && each[1].label == 9 && each[1].both == 5 && each[1].one == 1 && each[1].max == 0);
  assert_int_equal(tc_depths_compare(pixels, N, &all, each, 1), 1);
  assert_int_equal(each[0].both, 100);
}

/* ---- several rays a pixel, labels ---- */

/* What the meter says of the scene in all modes that it can measure is what it said of coarse steps, and of fine ones
 * little: another truth, such as the ray of the centre, would be as far from both. */
static void assert_step_alone_counts(tc_scene *s, tc_volume *labels, const char *what) {
  static const double steps[] = {2, 0.125};
  tc_meter_result found[2];
  for (int i = 0; i < 2; i++) {
    GError *error = NULL;
    g_auto(tc_frame) drawn = {0};
    s->sampling.step = steps[i] / s->sampling.rays_per_pixel;
    if (!tc_render(renderer, volume, s, &(tc_render_request){.want_linear = true, .labels = labels}, &drawn,
                   &error))
      fail_msg("%s: %s", what, error->message);
    tc_meter *meter = tc_meter_new(&drawn, 300, 1);
    if (!tc_meter_measure(meter, &(tc_meter_subject){.volume = volume, .labels = labels, .scene = s}, 0, &found[i],
                          &error))
      fail_msg("%s: %s", what, error->message);
    tc_meter_free(meter);
  }
  printf("  %s: rms %.2e at a spacing of 2 voxels, %.2e at 1/8\n", what, found[0].rms, found[1].rms);
  assert_true(found[1].rms < 8e-4);
  assert_true(s->mode == TC_MODE_ISOSURFACE || found[0].rms >= 4 * found[1].rms);
}

TEST(the_truth_of_many_rays_is_their_mean) {
  static const struct {
    tc_mode mode;
    const char *name;
  } modes[] = {{TC_MODE_DVR, "dvr"},
               {TC_MODE_MIP, "mip"},
               {TC_MODE_MINIP, "minip"},
               {TC_MODE_AVERAGE, "average"},
               {TC_MODE_ISOSURFACE, "isosurface"}};
  tc_scene s = scene; /* borrows */
  tc_subpixel rays[5];
  tc_subpixel_rays(5, rays);
  GError *error = NULL;
  tc_reference *reference = tc_reference_new(volume, &s, WIDTH, HEIGHT, 1e-8, &error);
  double mean[4] = {0}, middle[4], said[4];
  s.sampling.rays_per_pixel = 5;
  for (int r = 0; r < 5; r++) {
    double one[4];
    tc_reference_pixel(reference, 30.5 + rays[r].x, 20.5 + rays[r].y, one);
    for (int c = 0; c < 4; c++)
      mean[c] += one[c] / 5;
  }
  tc_reference_pixel(reference, 30.5, 20.5, middle);
  tc_meter_truth(reference, &s, 30, 20, 1, said);
  for (int c = 0; c < 4; c++)
    assert_float_equal(said[c], mean[c], 1e-15);
  assert_true(fabs(said[0] - middle[0]) > 1e-4); /* and it is no other's */
  s.sampling.rays_per_pixel = 1;
  tc_meter_truth(reference, &s, 30, 20, 1, said);
  assert_memory_equal(said, middle, sizeof said);
  tc_reference_free(reference);
  s.sampling.rays_per_pixel = 4;
  s.isosurface.value = s.window.center;
  for (size_t m = 0; m < sizeof modes / sizeof *modes; m++) {
    s.mode = modes[m].mode;
    assert_step_alone_counts(&s, NULL, modes[m].name);
  }
}

static double stripes(double x, double y, double z, const void *context) { return (int)(x / 5) % 3; }

TEST(labels_are_measured_too) {
  char reason[96];
  g_auto(tc_scene) s;
  const tc_volume_desc *d = tc_volume_describe(volume);
  test_grid grid = {.dims = {d->dims[0], d->dims[1], d->dims[2]}, .type = TC_U8};
  memcpy(grid.spacing, d->spacing, sizeof grid.spacing);
  memcpy(grid.origin, d->origin, sizeof grid.origin);
  g_autoptr(tc_volume) labels = test_volume(&grid, stripes, NULL);
  tc_scene_copy(&s, &scene);
  strcpy(s.labels.volume, "stripes");
  s.labels.opacity = 0.8;
  assert_false(tc_meter_refuses(&s, reason, sizeof reason));
  for (s.sampling.rays_per_pixel = 1; s.sampling.rays_per_pixel <= 3; s.sampling.rays_per_pixel += 2)
    assert_step_alone_counts(&s, labels, s.sampling.rays_per_pixel == 1 ? "labels" : "labels, three rays a pixel");
}

TESTS(set_up, tear_down)
