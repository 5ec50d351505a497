/* The gl back end's pictures against the cpu back end's: the same scenes on both, in the same run.
 *
 * The contract (NUMERICS section 5): equal within 1/255 at every pixel but for ties at edges, whose share is printed.
 * Runs on whatever OpenGL 4.5 EGL gives (llvmpipe without a GPU); without any it says so and passes nothing. */
#include "tests/support/test.h"

#include "renderer/gl/device.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"

static tc_renderer *gl, *cpu;
static GError *error;

static int set_up(void **state) {
  tc_gl_report report;
  if (!tc_gl_report_read(&report, &error)) {
    printf("skipped: %s\n", error->message);
    g_clear_error(&error);
    return 0;
  }
  printf("gl: %s, %s (%s, %s)\n", report.renderer, report.version, report.platform,
         report.hardware ? "hardware" : "software");
  gl = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_GL}, &error);
  cpu = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU}, &error);
  return gl && cpu ? 0 : -1;
}

static int tear_down(void **state) {
  tc_renderer_free(gl);
  tc_renderer_free(cpu);
  return 0;
}

/* ---- comparing ---- */

typedef struct pair {
  tc_frame gl, cpu;
} pair;

static void finish(pair *p) {
  tc_frame_finish(&p->gl);
  tc_frame_finish(&p->cpu);
}

static void render_both(pair *p, tc_volume *volume, const tc_scene *scene) {
  const tc_render_request request = {.want_linear = true};
  memset(p, 0, sizeof *p);
  assert_made(tc_render(cpu, volume, scene, &request, &p->cpu, &error));
  assert_made(tc_render(gl, volume, scene, &request, &p->gl, &error));
}

/* No NaN, opacity in 0..1, colour at most opacity (times the brightest colour, which is at most 1). */
static void check_sane(const tc_frame *frame) {
  for (size_t i = 0; i < (size_t)frame->width * frame->height; i++) {
    const float *c = frame->linear + 4 * i;
    if (!(c[3] >= 0 && c[3] <= 1)) fail_msg("pixel %zu: opacity %g", i, c[3]);
    for (int k = 0; k < 3; k++)
      if (!(c[k] >= 0 && c[k] <= c[3] + 2e-6f)) fail_msg("pixel %zu: colour %g over opacity %g", i, c[k], c[3]);
  }
}

/* Prints the difference and fails where more than `ties` (a share) of the pixels are off by over 1/255. */
static void expect_equal(const char *what, tc_volume *volume, const tc_scene *scene, double ties) {
  pair p;
  render_both(&p, volume, scene);
  check_sane(&p.gl);
  size_t pixels = (size_t)p.gl.width * p.gl.height, over = 0, seen = 0;
  double max = 0, sum = 0;
  int max_byte = 0;
  for (size_t i = 0; i < pixels; i++) {
    double worst = 0;
    int worst_byte = 0;
    for (size_t k = 4 * i; k < 4 * i + 4; k++) {
      worst = fmax(worst, fabs((double)p.gl.linear[k] - p.cpu.linear[k]));
      worst_byte = MAX(worst_byte, abs(p.gl.rgba[k] - p.cpu.rgba[k]));
    }
    sum += worst;
    seen += p.cpu.linear[4 * i + 3] > 0;
    bool tie = worst > 1.0 / 255 || worst_byte > 1;
    over += tie;
    if (tie) {
      if (over <= 3)
        printf("    tie at %zu,%zu: cpu %g %g %g %g, gl %g %g %g %g\n", i % p.gl.width, i / p.gl.width,
               p.cpu.linear[4 * i], p.cpu.linear[4 * i + 1], p.cpu.linear[4 * i + 2], p.cpu.linear[4 * i + 3],
               p.gl.linear[4 * i], p.gl.linear[4 * i + 1], p.gl.linear[4 * i + 2], p.gl.linear[4 * i + 3]);
      continue;
    }
    max = fmax(max, worst);
    max_byte = MAX(max_byte, worst_byte);
  }
  printf("  %-44s max %.2e mean %.2e levels %d over 1/255: %zu of %zu pixels (%zu show something)\n", what, max,
         sum / (double)pixels, max_byte, over, pixels, seen);
  if ((double)over > ties * (double)pixels)
    fail_msg("%s: %zu of %zu pixels are off by more than 1/255", what, over, pixels);
  /* The statistics count the same rays and samples, but for the same ties. */
  double rays = (double)p.cpu.stats.rays;
  if (fabs((double)p.gl.stats.rays - rays) > 2 + ties * (double)pixels + 0.01 * rays)
    fail_msg("%s: %g rays, cpu %g", what, (double)p.gl.stats.rays, rays);
  finish(&p);
}

/* Knots at shares of the volume's range. */
static void set_knots(tc_scene *scene, const tc_volume *volume, tc_knot_kind kind, const tc_knot *knots, size_t count) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  tc_knot placed[16];
  for (size_t i = 0; i < count; i++) {
    placed[i] = knots[i];
    placed[i].value = s->min + knots[i].value * (s->max - s->min);
  }
  test_scene_knots(scene, kind, placed, count);
}

static const tc_knot soft[] = {
    {0, {0.1, 0.1, 0.6}, 0}, {0.35, {0.2, 0.8, 0.3}, 0.01}, {0.6, {0.9, 0.7, 0.2}, 0.08}, {1, {1, 0.95, 0.9}, 0.3}};
static const tc_knot steep[] = {{0, {0, 0, 0}, 0},          {0.45, {0.9, 0.4, 0.2}, 0}, {0.45, {0.9, 0.4, 0.2}, 3},
                                {0.55, {0.9, 0.9, 0.6}, 8}, {0.55, {0, 0, 1}, 0.02},    {1, {0.2, 0.3, 1}, 0.05}};

static const double oblique[3] = {0.4, -1, 0.3};

/* ---- scenes ---- */

TEST(test_voxel_types) {
  needs(gl);
  const double wavelength = 23;
  const struct {
    tc_voxel_type type;
    double slope, intercept;
  } kinds[] = {{TC_U8, 1.0 / 255, 0},
               {TC_I8, 1.0 / 255, 128.0 / 255},
               {TC_U16, 1.0 / 65535, 0},
               {TC_I16, -1.0 / 65535, 0.5},
               {TC_F32, 1, 0}};
  for (size_t i = 0; i < G_N_ELEMENTS(kinds); i++) {
    test_grid grid = {
        .dims = {48, 40, 44}, .type = kinds[i].type, .slope = kinds[i].slope, .intercept = kinds[i].intercept};
    g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
    tc_scene scene;
    char what[64];
    for (int projection = 0; projection < TC_PROJECTION_COUNT; projection++)
      for (int sharp = (projection + (int)i) % STRIDE(2); sharp < 2; sharp += STRIDE(2)) {
        test_scene(&scene, 200, 150);
        test_scene_frame(&scene, volume, (tc_projection)projection, oblique);
        set_knots(&scene, volume, sharp ? TC_KNOT_EXTINCTION : TC_KNOT_OPACITY, sharp ? steep : soft,
                  sharp ? G_N_ELEMENTS(steep) : G_N_ELEMENTS(soft));
        snprintf(what, sizeof what, "%s %s %s", tc_voxel_type_name(kinds[i].type),
                 projection == TC_PERSPECTIVE ? "perspective" : "orthographic", sharp ? "steep" : "soft");
        expect_equal(what, volume, &scene, 0);
        tc_scene_clear(&scene);
      }
  }
}

TEST(test_noise_volume) {
  needs(gl);
  const unsigned seed = 7;
  test_grid grid = {.dims = {64, 64, 64}, .type = TC_U16, .slope = 1.0 / 65535};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_noise, &seed);
  g_auto(tc_scene) scene;
  test_scene(&scene, 300, 300);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, oblique);
  set_knots(&scene, volume, TC_KNOT_EXTINCTION, steep, G_N_ELEMENTS(steep));
  /* White noise under jumps: neighbouring positions differ by whole features, so that rounding of a position shows. */
  expect_equal("noise, steep", volume, &scene, 1e-3);
}

TEST(test_awkward_sizes) {
  needs(gl);
  const int sizes[][3] = {{1, 1, 1},   {1, 17, 1},  {1, 1, 33},  {29, 1, 1},  {2, 2, 2}, {1, 20, 30},
                          {20, 1, 30}, {20, 30, 1}, {256, 1, 7}, {3, 257, 2}, {2, 1, 2}};
  const unsigned seed = 3;
  const double side[3] = {-0.7, -1, 0.5};
  for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++)
    for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type += 3) {
      test_grid grid = {.type = (tc_voxel_type)type, .slope = type == TC_U8 ? 1.0 / 255 : 1.0 / 32767};
      memcpy(grid.dims, sizes[i], sizeof grid.dims);
      g_autoptr(tc_volume) volume = test_volume(&grid, test_noise, &seed);
      tc_scene scene;
      char what[64];
      for (int projection = 0; projection < TC_PROJECTION_COUNT; projection++) {
        test_scene(&scene, 120, 120);
        test_scene_frame(&scene, volume, (tc_projection)projection, side);
        set_knots(&scene, volume, TC_KNOT_OPACITY, soft, G_N_ELEMENTS(soft));
        scene.transfer_function.unit_distance_mm = 0.1;
        snprintf(what, sizeof what, "%dx%dx%d %s %s", grid.dims[0], grid.dims[1], grid.dims[2],
                 tc_voxel_type_name(grid.type), projection == TC_PERSPECTIVE ? "perspective" : "orthographic");
        expect_equal(what, volume, &scene, 0);
        tc_scene_clear(&scene);
      }
    }
}

/* More slices than a texture has layers (2048 on most devices), and sides of 1:1000: a look across the middle of noise,
 * where each slice shows, and one down the long axis of waves (down noise, single precision's 1/4000 of a voxel there
 * shows). */
static void look_at_long_volume(const char *what, const test_grid *grid, double height, bool along) {
  const unsigned seed = 3;
  const double wavelength = 40;
  const int axis = grid->dims[0] > 1000 ? 0 : 2;
  g_autoptr(tc_volume) volume =
      along ? test_volume(grid, test_waves, &wavelength) : test_volume(grid, test_noise, &seed);
  double lo[3], hi[3], middle[3], from[3];
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) middle[k] = 0.5 * (lo[k] + hi[k]);
  tc_volume_index_to_lps(volume, middle, middle);
  memcpy(from, middle, sizeof from);
  from[along ? axis : 1] -= along ? 3000 : 20;
  from[0] += 0.1;
  g_auto(tc_scene) scene;
  test_scene(&scene, 140, 140);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, from, middle, along ? height / 4 : height);
  set_knots(&scene, volume, TC_KNOT_OPACITY, soft, G_N_ELEMENTS(soft));
  expect_equal(what, volume, &scene, 0);
}

TEST(test_long_volumes) {
  needs(gl);
  const struct {
    const char *what;
    test_grid grid;
    double height;
  } cases[] = {
      {"5x7x2100", {.dims = {5, 7, 2100}, .type = TC_U8, .slope = 1.0 / 255}, 57},
      {"3x1x4099", {.dims = {3, 1, 4099}, .type = TC_U8, .slope = 1.0 / 255}, 57},
      {"9x8x5000 i16", {.dims = {9, 8, 5000}, .type = TC_I16, .slope = 1.0 / 32767}, 57},
      {"2100x5x4", {.dims = {2100, 5, 4}, .type = TC_F32}, 57},
      {"spacing 1:1000", {.dims = {40, 40, 12}, .type = TC_U8, .spacing = {0.01, 0.01, 10}, .slope = 1.0 / 255}, 0.8}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++)
    for (int along = (int)i % STRIDE(2); along < 2; along += STRIDE(2)) {
      char what[64];
      snprintf(what, sizeof what, "%s, %s", cases[i].what, along ? "along" : "across");
      look_at_long_volume(what, &cases[i].grid, cases[i].height, along);
    }
}

TEST(test_geometry) {
  needs(gl);
  const double wavelength = 15;
  const double c = cos(0.35), s = sin(0.35);
  const struct {
    const char *what;
    test_grid grid;
  } cases[] = {
      {"spacing 0.3, 0.7, 5 mm", {.dims = {60, 50, 20}, .type = TC_I16, .spacing = {0.3, 0.7, 5}, .slope = 1e-4}},
      {"sheared direction, far origin",
       {.dims = {40, 44, 30},
        .type = TC_U8,
        .slope = 1.0 / 255,
        .direction = {1, 0, 0, 0, c, s, 0, 0, 1},
        .origin = {-1234.5, 987, 4321}}},
      {"rotated and mirrored", {.dims = {40, 30, 35}, .type = TC_F32, .direction = {c, s, 0, s, -c, 0, 0, 0, -1}}}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases); i++) {
    g_autoptr(tc_volume) volume = test_volume(&cases[i].grid, test_waves, &wavelength);
    g_auto(tc_scene) scene;
    test_scene(&scene, 160, 160);
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, oblique);
    set_knots(&scene, volume, TC_KNOT_OPACITY, soft, G_N_ELEMENTS(soft));
    expect_equal(cases[i].what, volume, &scene, 0);
  }
}

TEST(test_cameras) {
  needs(gl);
  const double wavelength = 19;
  test_grid grid = {.dims = {40, 40, 40}, .type = TC_U8, .slope = 1.0 / 255};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
  const struct {
    const char *what;
    tc_projection projection;
    double from[3], to[3], size, ties;
  } cameras[] = {{"inside", TC_PERSPECTIVE, {20, 20, 20}, {0, 3, 9}, 90, 0},
                 {"inside, orthographic", TC_ORTHOGRAPHIC, {20, 20, 20}, {39, 3, 9}, 50, 0},
                 {"on a face", TC_PERSPECTIVE, {20, 0, 20}, {20, 39, 20}, 60, 0},
                 {"on a corner", TC_PERSPECTIVE, {0, 0, 0}, {20, 20, 21}, 60, 0},
                 {"at 1e7 mm", TC_PERSPECTIVE, {1e7, -2e6, 3e6}, {20, 20, 20}, 4e-4, 0},
                 {"at 1e7 mm, orthographic", TC_ORTHOGRAPHIC, {1e7, -2e6, 3e6}, {20, 20, 20}, 80, 0},
                 {"along x", TC_ORTHOGRAPHIC, {-100, 19.5, 19.5}, {0, 19.5, 19.5}, 45, 0},
                 {"along -z, through the edges", TC_ORTHOGRAPHIC, {19.5, 19.5, 99}, {19.5, 19.5, 0}, 39, 0},
                 {"field of view 1e-3 degrees", TC_PERSPECTIVE, {1000, 0, 0}, {20, 20, 20}, 1e-3, 0},
                 {"field of view 179 degrees", TC_PERSPECTIVE, {20, -3, 20}, {20, 20, 20}, 179, 0},
                 {"behind the camera", TC_PERSPECTIVE, {20, 60, 20}, {20, 90, 20}, 60, 0}};
  for (size_t i = 0; i < G_N_ELEMENTS(cameras); i++) {
    g_auto(tc_scene) scene;
    test_scene(&scene, 180, 180);
    test_scene_look(&scene, cameras[i].projection, cameras[i].from, cameras[i].to, cameras[i].size);
    set_knots(&scene, volume, TC_KNOT_OPACITY, soft, G_N_ELEMENTS(soft));
    expect_equal(cameras[i].what, volume, &scene, cameras[i].ties);
  }
}

TEST(test_steps) {
  needs(gl);
  const double wavelength = 19, steps[] = {0.05, 0.37, 3, 1000};
  test_grid grid = {.dims = {30, 30, 30}, .type = TC_I16, .slope = 1.0 / 30000};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
  for (size_t i = 0; i < G_N_ELEMENTS(steps); i++) {
    g_auto(tc_scene) scene;
    char what[32];
    test_scene(&scene, 130, 130);
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, oblique);
    set_knots(&scene, volume, TC_KNOT_OPACITY, soft, G_N_ELEMENTS(soft));
    scene.sampling.step = steps[i];
    snprintf(what, sizeof what, "step %g", steps[i]);
    expect_equal(what, volume, &scene, 0);
  }
}

TEST(test_extreme_extinction) {
  needs(gl);
  const double wavelength = 19, scales[] = {1e-12, 1e-3, 1e3, 1e6, 1e12};
  test_grid grid = {.dims = {30, 30, 30}, .type = TC_U16, .slope = 1.0 / 65535};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
  for (size_t i = 0; i < G_N_ELEMENTS(scales); i++) {
    g_auto(tc_scene) scene;
    tc_knot scaled[G_N_ELEMENTS(soft)];
    char what[32];
    memcpy(scaled, soft, sizeof soft);
    for (size_t k = 0; k < G_N_ELEMENTS(soft); k++) scaled[k].amount *= scales[i];
    test_scene(&scene, 130, 130);
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, oblique);
    set_knots(&scene, volume, TC_KNOT_EXTINCTION, scaled, G_N_ELEMENTS(soft));
    snprintf(what, sizeof what, "extinction x %g", scales[i]);
    /* A ray that cuts a corner has only a last, short segment: its opacity hangs on the last bit of a full segment's.
     */
    expect_equal(what, volume, &scene, 2e-4);
  }
}

/* A constant volume of one opaque colour comes out as exactly that colour, whatever the compositing space. */
TEST(test_opaque_block) {
  needs(gl);
  const double one = 1;
  const double colors[][3] = {{1, 0, 0}, {0.2, 0.6, 0.4}};
  test_grid grid = {.dims = {16, 16, 16}, .type = TC_U8};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_constant, &one);
  for (int linear_light = 0; linear_light < 2; linear_light++)
    for (size_t i = 0; i < G_N_ELEMENTS(colors); i++) {
      g_auto(tc_scene) scene;
      g_auto(tc_frame) frame = {0};
      tc_knot knot = {1, {colors[i][0], colors[i][1], colors[i][2]}, 1e4};
      test_scene(&scene, 64, 64);
      test_scene_frame(&scene, volume, TC_PERSPECTIVE, oblique);
      test_scene_knots(&scene, TC_KNOT_EXTINCTION, &knot, 1);
      scene.image.linear_light = linear_light;
      assert_made(tc_render(gl, volume, &scene, NULL, &frame, &error));
      const uint8_t *center = frame.rgba + (32 * 64 + 32) * 4;
      for (int k = 0; k < 3; k++) assert_int_equal(center[k], (int)(colors[i][k] * 255 + 0.5));
      assert_int_equal(center[3], 255);
    }
}

TEST(test_termination) {
  needs(gl);
  const double wavelength = 23, threshold = 0.01;
  test_grid grid = {.dims = {60, 60, 57}, .type = TC_U8, .slope = 1.0 / 255};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
  g_auto(tc_scene) scene;
  const tc_render_request request = {.want_linear = true};
  g_auto(tc_frame) whole = {0}, early = {0};
  test_scene(&scene, 200, 200);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, oblique);
  set_knots(&scene, volume, TC_KNOT_EXTINCTION, soft, G_N_ELEMENTS(soft));
  assert_made(tc_render(gl, volume, &scene, &request, &whole, &error));
  scene.sampling.termination = threshold;
  assert_made(tc_render(gl, volume, &scene, &request, &early, &error));
  double worst = 0;
  for (size_t i = 0; i < 200 * 200 * 4; i++) worst = fmax(worst, fabs((double)whole.linear[i] - early.linear[i]));
  printf("  termination at %g changes a pixel by at most %.3g; samples %zu -> %zu\n", threshold, worst,
         (size_t)whole.stats.samples, (size_t)early.stats.samples);
  assert_true(worst <= threshold);
  assert_true(early.stats.samples < whole.stats.samples);
  assert_true(early.stats.rays == whole.stats.rays);
  expect_equal("with termination", volume, &scene, 0);
}

TEST(test_resolve) {
  needs(gl);
  const double wavelength = 23;
  test_grid grid = {.dims = {40, 40, 40}, .type = TC_U8, .slope = 1.0 / 255};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
  for (int i = 0; i < 4; i++) {
    g_auto(tc_scene) scene;
    char what[64];
    test_scene(&scene, 150, 150);
    test_scene_frame(&scene, volume, TC_PERSPECTIVE, oblique);
    set_knots(&scene, volume, TC_KNOT_OPACITY, soft, G_N_ELEMENTS(soft));
    scene.image.transparent = i & 1;
    scene.image.linear_light = i & 2;
    scene.image.background[0] = 0.9;
    scene.image.background[1] = 0.3;
    scene.image.background[2] = 0.01;
    snprintf(what, sizeof what, "%s%s", i & 1 ? "transparent" : "background", i & 2 ? ", linear light" : "");
    expect_equal(what, volume, &scene, 0);
  }
}

/* Leaping leaves samples out and changes no bit; and the picture is still the cpu's. */
TEST(test_leaping) {
  needs(gl);
  const double wavelength = 40;
  const tc_knot shell[] = {
      {0.0, {0.9, 0.6, 0.3}, 0}, {0.7, {0.9, 0.6, 0.3}, 0}, {0.75, {1, 0.9, 0.8}, 0.4}, {1, {1, 1, 1}, 0.5}};
  const int sizes[][3] = {{70, 64, 90}, {1, 50, 60}, {64, 3, 64}, {33, 31, 1}};
  const int blocks[] = {0, 2, 7, 16};
  for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++) {
    test_grid grid = {.type = i & 1 ? TC_I16 : TC_U8, .slope = i & 1 ? 1.0 / 32767 : 1.0 / 255};
    memcpy(grid.dims, sizes[i], sizeof grid.dims);
    g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
    for (size_t j = i % STRIDE(2); j < G_N_ELEMENTS(blocks); j += STRIDE(2)) {
      g_auto(tc_scene) scene;
      g_auto(tc_frame) leapt = {0}, whole = {0};
      tc_explanation plan;
      char what[64];
      test_scene(&scene, 160, 160);
      test_scene_frame(&scene, volume, j & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE, oblique);
      set_knots(&scene, volume, TC_KNOT_OPACITY, shell, G_N_ELEMENTS(shell));
      scene.skipping.block = blocks[j];
      scene.sampling.termination = j & 2 ? 0.01 : 0;
      scene.sampling.step = j == 3 ? 0.3 : 1;
      const tc_render_request request = {.want_linear = true, .explanation = &plan};
      assert_made(tc_render(gl, volume, &scene, &request, &leapt, &error));
      bool leaps = plan.key.skipping;
      snprintf(what, sizeof what, "%dx%dx%d, blocks of %d", sizes[i][0], sizes[i][1], sizes[i][2], blocks[j]);
      expect_equal(what, volume, &scene, 0);
      scene.skipping.mode = TC_SKIPPING_OFF;
      assert_made(tc_render(gl, volume, &scene, &request, &whole, &error));
      assert_false(plan.key.skipping);
      printf("    %s: %zu leaps, samples %zu of %zu\n", leaps ? "leapt" : "not worth leaping",
             (size_t)leapt.stats.leaps, (size_t)leapt.stats.samples, (size_t)whole.stats.samples);
      assert_memory_equal(leapt.linear, whole.linear, 160 * 160 * 16);
      assert_memory_equal(leapt.rgba, whole.rgba, 160 * 160 * 4);
      if (i == 0 && j == 0) assert_true(leaps && leapt.stats.leaps > 0 && leapt.stats.samples < whole.stats.samples);
    }
  }
}

/* Tiles: pictures of odd sizes, smaller and larger than a tile, with and without floats, are the same picture. */
TEST(test_picture_sizes) {
  needs(gl);
  const double wavelength = 23;
  const int sizes[][2] = {{1, 1}, {1, 700}, {700, 1}, {7, 9}, {517, 333}, {256, 256}, {257, 255}};
  test_grid grid = {.dims = {30, 30, 30}, .type = TC_U8, .slope = 1.0 / 255};
  g_autoptr(tc_volume) volume = test_volume(&grid, test_waves, &wavelength);
  for (size_t i = 0; i < G_N_ELEMENTS(sizes); i++) {
    g_auto(tc_scene) scene;
    g_auto(tc_frame) with = {0}, without = {0};
    char what[32];
    test_scene(&scene, sizes[i][0], sizes[i][1]);
    test_scene_frame(&scene, volume, TC_ORTHOGRAPHIC, oblique);
    set_knots(&scene, volume, TC_KNOT_OPACITY, soft, G_N_ELEMENTS(soft));
    snprintf(what, sizeof what, "%dx%d pixels", sizes[i][0], sizes[i][1]);
    expect_equal(what, volume, &scene, 0);
    assert_made(tc_render(gl, volume, &scene, &(tc_render_request){.want_linear = true}, &with, &error));
    assert_made(tc_render(gl, volume, &scene, NULL, &without, &error));
    assert_memory_equal(with.rgba, without.rgba, (size_t)sizes[i][0] * sizes[i][1] * 4);
  }
}

int main(void) {
  setenv("MESA_SHADER_CACHE_DISABLE", "true", 1); /* its key misses some of Mesa's own settings */
  return run_all_tests(set_up, tear_down);
}
