/* Planar reformats: the window, and what other members of the scene do to a slice, clip it, refuse it, or leave it alone. */
#include "tests/support/mpr.h"

TEST(window_maps_to_grey) {
  static const double windows[][2] = {{50, 100}, {30, 10}, {30, 1e-12}, {1e6, 1}, {-1e6, 1}, {50, 1e9}, {0, 1e-300}};
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {101, 3, 3}, .type = TC_I16, .slope = 0.5, .intercept = -7},
                                  test_linear, (double[4]){1, 0, 0, 0});
  EACH_RENDERER(m)
    for (size_t w = 0; w < G_N_ELEMENTS(windows); w++) {
      g_auto(tc_scene) scene;
      scene_of(&scene, TC_AXIAL, 0, 1);
      scene.image.width = 101, scene.image.height = 3;
      scene.mpr.zoom = 100.0 / 101; /* pixel x is voxel x */
      scene.window.center = windows[w][0], scene.window.width = windows[w][1];
      const float *got = render(m, volume, &scene);
      for (int x = 0; x < 101; x++) {
        double off = fabs(got[4 * (101 + x)] - grey_of(&scene, x));
        bool in_doubt = windows[w][1] < 1e-6 && x == windows[w][0]; /* between black and white in one value */
        if (off > 1e-3 && !in_doubt)
          fail_msg("%s: window %g, %g: value %d shows %g", test_names[m], windows[w][0], windows[w][1], x,
                   got[4 * (101 + x)]);
      }
    }
}

/* What means nothing to a slice changes nothing, and is not looked at. */
TEST(other_members_are_ignored) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[4], TC_U16, 1);
  EACH_RENDERER(m) {
    g_auto(tc_scene) scene;
    scene_of(&scene, TC_CORONAL, 20000, 50000);
    scene.image.background[2] = 0.4;
    render(m, volume, &scene);
    g_autofree uint8_t *plain = g_memdup2(test_frames[m].rgba, WIDTH * HEIGHT * 4);
    scene.classification = TC_POST, scene.order = TC_BACK_TO_FRONT, scene.shading.model = TC_SHADING_GOOCH;
    scene.image.linear_light = scene.sampling.coherence = scene.sampling.jitter = true;
    scene.sampling.termination = 0.5;
    scene.transfer_function.points[0].value = NAN;
    scene.camera.fov_y_deg = 0;
    memcpy(scene.camera.target, scene.camera.position, sizeof scene.camera.target);
    render(m, volume, &scene);
    assert_memory_equal(test_frames[m].rgba, plain, WIDTH * HEIGHT * 4);
    assert_int_equal(test_frames[m].rgba[2], 102); /* the background, in a corner beside the field */
    scene.image.transparent = true;
    render(m, volume, &scene);
    assert_int_equal(test_frames[m].rgba[3], 0);
    assert_int_equal(test_frames[m].rgba[4 * (HEIGHT / 2 * WIDTH + WIDTH / 2) + 3], 255);
  }
}

/* A clip box and plane cut slices where they lie, and a slab's column to what is left: its ends are sampled there. */
TEST(clipping_cuts_slices) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[0], TC_U8, 1); /* 19x15x11 mm from the origin */
  EACH_RENDERER(m) {
    g_auto(tc_scene) scene;
    scene_of(&scene, TC_AXIAL, 0, 255);
    scene.clip.has_box = true;
    /* z = 5: the plane itself */
    memcpy(scene.clip.box, (double[2][3]){{3, 2, 5}, {12, 40, 40}}, sizeof scene.clip.box);
    scene.clip.n_planes = 1;
    memcpy(scene.clip.planes[0], (double[4]){0, -1, 0, 9.5}, sizeof scene.clip.planes[0]); /* y <= 9.5 */
    for (int slab = 0; slab < 2; slab++) {
      scene.mpr.thickness_mm = slab ? 4 : 0; /* z from 3 to 7, of which 5 to 7 is left */
      const float *got = render(m, volume, &scene);
      plane p = plane_of(&scene, volume);
      size_t seen = 0;
      for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double lps[3], sum = 0;
        pixel_lps(&p, &scene, i % WIDTH, i / WIDTH, 0, lps);
        double rim = fmin(fmin(lps[0] - 3, 12 - lps[0]), fmin(lps[1] - 2, 9.5 - lps[1]));
        if (fabs(rim) < 2e-3) continue;
        for (int z = 0; z < 3 && rim > 0; z++) /* straight volume: LPS is index */
          sum += (z == 1 ? 0.5 : 0.25) * value_at(volume, (double[3]){lps[0], lps[1], slab ? 5 + z : 5});
        if (got[4 * i + 3] != (rim > 0) || fabs(got[4 * i] - sum / 255) > fmax(allowed(m), 1e-3))
          fail_msg("%s, slab %d: pixel %d,%d: %g (opacity %g), expected %g", test_names[m], slab, i % WIDTH, i / WIDTH,
                   got[4 * i], got[4 * i + 3], sum / 255);
        seen += rim > 0;
      }
      assert_true(seen > 500);
    }
  }
}

TEST(plan_names_what_runs) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[0], TC_U16, 1);
  static const char *const names[] = {"mpr.slice.linear.u16.", "mpr.mip.nearest.u16.", "mpr.minip.linear.u16.",
                                      "mpr.average.nearest.u16."};
  EACH_RENDERER(m)
    for (int slab = 0; slab < 4; slab++) {
      g_auto(tc_scene) scene;
      tc_explanation plan;
      GError *error = NULL;
      scene_of(&scene, TC_AXIAL, 0, 1);
      scene.filter = slab % 2 ? TC_FILTER_NEAREST : TC_FILTER_LINEAR;
      if (slab) scene.mpr.thickness_mm = 5, scene.mpr.projection = (tc_slab_projection)(slab - 1);
      const tc_frame *frame = test_draw(m, volume, &scene, NULL, &plan);
      assert_int_equal(strncmp(plan.kernel, names[slab], strlen(names[slab])), 0);
      static const tc_stage out[] = {TC_STAGE_TABLE_1D, TC_STAGE_TABLE_2D, TC_STAGE_GRADIENT, TC_STAGE_SKIPPING};
      for (size_t i = 0; i < G_N_ELEMENTS(out); i++) {
        assert_false(plan.stages[out[i]].included);
        assert_true(plan.stages[out[i]].reason[0] && plan.stages[out[i]].bytes == 0);
      }
      assert_true(frame->stats.tables_ms == 0 && frame->stats.skip_ms == 0);
      if (!slab) assert_int_equal(frame->stats.samples, frame->stats.rays); /* one sample a pixel */
      assert_true(tc_renderer_explain(test_renderers[m], volume, &scene, NULL, &plan, &error));
    }
}

static void expect_refused(tc_volume *volume, const tc_scene *scene, int code, const char *pointer) {
  tc_explanation plan;
  g_autoptr(GError) error = NULL;
  if (tc_explain(volume, scene, WIDTH, HEIGHT, &plan, &error)) fail_msg("%s was not refused", pointer);
  assert_int_equal(error->code, code);
  assert_string_equal(tc_error_pointer(error), pointer);
}

TEST(refusals_point_at_members) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[0], TC_U8, 1);
  tc_scene s, good;
  scene_of(&good, TC_OBLIQUE, 0, 255);
#define REFUSED(edit, code, pointer) (s = good, edit, expect_refused(volume, &s, code, pointer))
  REFUSED(s.mpr.thickness_mm = -1, TC_ERROR_INVALID, "/mpr/thickness");
  REFUSED(s.mpr.thickness_mm = NAN, TC_ERROR_INVALID, "/mpr/thickness");
  REFUSED(s.mpr.thickness_mm = 1e9, TC_ERROR_LIMIT, "/mpr/thickness");
  REFUSED(s.mpr.zoom = 0, TC_ERROR_INVALID, "/mpr/zoom");
  REFUSED(s.mpr.zoom = INFINITY, TC_ERROR_INVALID, "/mpr/zoom");
  REFUSED(memset(s.mpr.normal, 0, sizeof s.mpr.normal), TC_ERROR_INVALID, "/mpr/normal");
  REFUSED(memset(s.mpr.up, 0, sizeof s.mpr.up), TC_ERROR_INVALID, "/mpr/up");
  REFUSED(memcpy(s.mpr.up, s.mpr.normal, sizeof s.mpr.up), TC_ERROR_INVALID, "/mpr/up");
  REFUSED((s.mpr.has_center = true, s.mpr.center[1] = NAN), TC_ERROR_INVALID, "/mpr/center");
  REFUSED(s.window.width = 0, TC_ERROR_INVALID, "/window/width");
  REFUSED(s.window.center = NAN, TC_ERROR_INVALID, "/window/center");
  REFUSED(s.sampling.step = 0, TC_ERROR_INVALID, "/sampling/step");
  REFUSED(s.filter = TC_FILTER_COUNT, TC_ERROR_INVALID, "/filter");
  REFUSED(s.sampling.rays_per_pixel = 4, TC_ERROR_UNSUPPORTED, "/sampling/raysPerPixel");
  REFUSED((s.clip.has_box = true, s.clip.box[0][1] = 1), TC_ERROR_INVALID, "/clip/box");
  REFUSED((strcpy(s.labels.volume, "x"), s.labels.opacity = 2), TC_ERROR_INVALID, "/labels/opacity");
  tc_explanation plan;
  s = good, s.mpr.orientation = TC_AXIAL; /* only oblique planes have a normal of their own */
  memset(s.mpr.normal, 0, sizeof s.mpr.normal);
  assert_true(tc_explain(volume, &s, WIDTH, HEIGHT, &plan, NULL));
  tc_scene_clear(&good);
}

/* The oblique plane that a new scene holds is the axial one. */
TEST(default_oblique_is_axial) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[6], TC_U16, 1);
  g_auto(tc_scene) scene;
  test_scene(&scene, WIDTH, HEIGHT);
  scene.mode = TC_MODE_MPR;
  whole_window(&scene, volume);
  render(SCALAR, volume, &scene);
  g_autofree uint8_t *axial = g_memdup2(test_frames[SCALAR].rgba, WIDTH * HEIGHT * 4);
  scene.mpr.orientation = TC_OBLIQUE;
  render(SCALAR, volume, &scene);
  assert_memory_equal(test_frames[SCALAR].rgba, axial, WIDTH * HEIGHT * 4);
}

TEST(threads_change_nothing) {
  g_autoptr(tc_volume) volume = noise_volume(&placings[4], TC_U16, 1);
  g_autoptr(tc_renderer) one = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 1}, NULL);
  g_autoptr(tc_renderer) three = tc_renderer_new(&(tc_renderer_options){.backend = TC_BACKEND_CPU, .threads = 3}, NULL);
  g_auto(tc_scene) scene;
  scene_of(&scene, TC_OBLIQUE, 0, 65535);
  scene.mpr.thickness_mm = 5;
  g_auto(tc_frame) a = {0}, b = {0};
  assert_true(tc_render(one, volume, &scene, NULL, &a, NULL));
  assert_true(tc_render(three, volume, &scene, NULL, &b, NULL));
  assert_memory_equal(a.rgba, b.rgba, WIDTH * HEIGHT * 4);
}

TESTS(test_renderers_open, test_renderers_close)
