/* Voxels without a value (NaN): they show in no mode, on any instruction set and on OpenGL, and add to nothing. */
#include "tests/support/test.h"

#include "renderer/mesh/mesh.h"
#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

enum { SIDE = 40, PIXELS = SIDE * SIDE, EDGE = 21 };

static const float *render(int which, tc_volume *volume, const tc_scene *scene) {
  return test_draw(which, volume, scene, &(tc_render_request){.want_linear = true}, NULL)->linear;
}

/* A signed map: waves of -1 .. 1 in a ball of 7 voxels, NaN around it and in a speck within. */
static double ball(double x, double y, double z, const void *wavelength) {
  const double center[3] = {10, 10, 10}, speck[3] = {12, 10, 8};
  if (test_radius2(x, y, z, center) > 49 || test_radius2(x, y, z, speck) < 2) return NAN;
  return 2 * test_waves(x, y, z, wavelength) - 1;
}

/* The left half has the value 7, the right none. */
static double half(double x, double y, double z, const void *unused) { return x <= 10 ? 7 : NAN; }

static tc_volume *make(test_field field) {
  return test_volume(&(test_grid){.dims = {EDGE, EDGE, EDGE}, .type = TC_F32}, field, &(double){9});
}

static void look(tc_scene *scene, const tc_volume *volume, tc_mode mode) {
  static const tc_knot knots[] = {{.value = -1, .color = {0.2, 0.4, 1}, .amount = 0.5},
                                  {.value = 0, .color = {1, 1, 1}, .amount = 0.1},
                                  {.value = 1, .color = {1, 0.3, 0.1}, .amount = 0.6}};
  test_scene(scene, SIDE, SIDE);
  test_scene_knots(scene, TC_KNOT_EXTINCTION, knots, 3);
  test_scene_frame(scene, volume, TC_PERSPECTIVE, (double[3]){1, -0.6, 0.4});
  scene->mode = mode;
  scene->window.center = 0;
  scene->window.width = 2.2;
  scene->sampling.step = 0.02;
}

/* At the end of a short step, pictures are what the reference integrates of what is there. */
TEST(what_is_left_is_the_truth) {
  static const tc_mode modes[] = {TC_MODE_DVR, TC_MODE_MIP, TC_MODE_MINIP, TC_MODE_AVERAGE, TC_MODE_ISOSURFACE};
  g_autoptr(tc_volume) volume = make(ball);
  assert_non_null(tc_volume_gaps(volume));
  for (size_t m = 0; m < sizeof modes / sizeof *modes; m++) {
    g_auto(tc_scene) scene;
    look(&scene, volume, modes[m]);
    scene.isosurface.value = 0.2;
    g_autofree float *truth = test_reference(volume, &scene, 1e-4);
    size_t clear = 0;
    for (int p = 0; p < PIXELS; p++) clear += truth[4 * p + 3] == 0;
    if (!(clear > PIXELS / 4 && clear < PIXELS * 95 / 100)) fail_msg("%zu of %d pixels are clear", clear, PIXELS); /* rays through gaps alone meet nothing */
    EACH_RENDERER(i) {
      const float *image = render(i, volume, &scene);
      double sum = 0;
      size_t off = 0;
      assert_true(test_compare(image, truth, PIXELS).finite);
      for (int k = 0; k < 4 * PIXELS; k++) {
        const double d = fabs((double)image[k] - (double)truth[k]);
        sum += d * d;
        off += d > 0.02;
      }
      print_message("  %-7s %s: rms %.1e, %zu of %d off\n", test_names[i], tc_mode_names[modes[m]],
                    sqrt(sum / (4 * PIXELS)), off, 4 * PIXELS);
      assert_true(off <= 4 * PIXELS / 100); /* rays along the edge of a gap */
    }
  }
}

/* x, of which the far half along y is NaN. */
static double slope(double x, double y, double z, const void *unused) { return y <= 10 ? x : NAN; }
/* In the far half values as far outside of 0.5 .. 20 as x is inside. */
static double slope_and_nothing(double x, double y, double z, const void *unused) { return y <= 10 ? x : fmin(0.5 - fmin(x - 0.5, 20 - x), 0.499); }
static double slope_alone(double x, double y, double z, const void *unused) { return x; }

static size_t shown_of(int which, tc_volume *volume, tc_mode mode) {
  g_auto(tc_scene) scene;
  size_t shown = 0;
  look(&scene, volume, mode);
  test_scene_frame(&scene, volume, TC_ORTHOGRAPHIC, (double[3]){1, 0, 0});
  scene.isosurface.value = 10.5;
  const float *image = render(which, volume, &scene);
  for (int p = 0; p < PIXELS; p++) shown += image[4 * p + 3] > 0.5f;
  return shown;
}

/* The surface ends with the last cell that has a value at all corners, and no other comes up along the gap. */
TEST(surfaces_end_at_a_gap) {
  tc_volume *gaps = make(slope), *whole = make(slope_alone);
  GError *error = NULL;
  EACH_RENDERER(i)
    for (int mesh = 0; mesh < 2; mesh++) {
      const tc_mode mode = mesh ? TC_MODE_MESH : TC_MODE_ISOSURFACE;
      const double share = (double)shown_of(i, gaps, mode) / (double)shown_of(i, whole, mode);
      if (!(fabs(share - 0.5) < 0.04)) fail_msg("%s, %s: %.3f of the surface shows", test_names[i], tc_mode_names[mode], share);
    }
  g_autoptr(tc_mesh) m = tc_mesh_extract(gaps, 10.5, &(tc_mesh_options){.normals = true}, &error);
  assert_non_null(m);
  assert_int_equal(m->n_triangles, 2 * 10 * 20);
  assert_int_equal(m->n_vertices, 11 * 21); /* none that no triangle has */
  for (size_t v = 0; v < m->n_vertices; v++) assert_true(fabs((double)m->positions[v][0] + m->origin[0] - 10.5) < 1e-4);
  tc_volume_unref(gaps);
  tc_volume_unref(whole);
}

/* Voxels that are NaN are no splats, and the surface is half way to them: the picture is that of the volume that has voxels as far
 * out of range there. */
TEST(splats_leave_gaps_out) {
  tc_volume *gaps = make(slope), *none = make(slope_and_nothing);
  EACH_RENDERER(i) {
    g_auto(tc_scene) scene;
    look(&scene, gaps, TC_MODE_SPLAT);
    scene.splat.threshold[0] = 0.5; /* x = 0 is out of range in both */
    scene.splat.threshold[1] = 20;
    g_autofree float *seen = g_memdup2(render(i, gaps, &scene), 4 * PIXELS * sizeof(float));
    const float *image = render(i, none, &scene);
    int off = 0;
    for (int p = 0; p < 4 * PIXELS; p++) off += fabsf(image[p] - seen[p]) > 1.f / 255;
    print_message("  %s: %d of %d off\n", test_names[i], off, 4 * PIXELS);
    assert_true(off < 4 * PIXELS / 50); /* at the corners, where a gap's value is the mean of fewer voxels */
    scene.camera.fov_y_deg = 90; /* voxels under a pixel are balls: no value counts but for being in range */
    g_autofree float *small = g_memdup2(render(i, gaps, &scene), 4 * PIXELS * sizeof(float));
    assert_memory_equal(small, render(i, none, &scene), 4 * PIXELS * sizeof(float));
  }
  tc_volume_unref(gaps);
  tc_volume_unref(none);
}

/* A surface at a gap looks to the gap, whatever the values before it. */
TEST(splats_at_a_gap_are_lit) {
  g_autoptr(tc_volume) gaps = make(slope);
  EACH_RENDERER(i) {
    g_auto(tc_scene) scene;
    int shown = 0, dark = 0;
    look(&scene, gaps, TC_MODE_SPLAT);
    test_scene_frame(&scene, gaps, TC_ORTHOGRAPHIC, (double[3]){0.2, 1, 0.1});
    tc_scene_light(&scene, true);
    scene.splat.threshold[0] = 0.5, scene.splat.threshold[1] = 20;
    const float *image = render(i, gaps, &scene);
    for (int p = 0; p < PIXELS; p++)
      if (image[4 * p + 3] > 0.9f) shown++, dark += (double)image[4 * p] < 0.6 * scene.isosurface.color[0];
    print_message("  %s: %d of %d pixels are dark\n", test_names[i], dark, shown);
    assert_true(shown > 400 && dark < shown / 4); /* its other sides */
  }
}

/* One pixel a voxel: shown where there is a value, and with it alone; between the last value and the first gap, up to
 * half way. */
TEST(slices_and_slabs_end_half_way_to_a_gap) {
  g_autoptr(tc_volume) volume = make(half);
  for (int slab = 0; slab <= TC_SLAB_PROJECTION_COUNT; slab++)
    for (int across = 0; across < 2; across++) {
      g_auto(tc_scene) scene;
      test_scene(&scene, SIDE, SIDE);
      scene.mode = TC_MODE_MPR;
      scene.mpr.orientation = across ? TC_AXIAL : TC_SAGITTAL;
      scene.mpr.has_center = true;
      for (int k = 0; k < 3; k++) scene.mpr.center[k] = 10;
      scene.mpr.thickness_mm = slab ? 6 : 0;
      scene.mpr.projection = (tc_slab_projection)(slab ? slab - 1 : 0);
      scene.window.center = 7;
      scene.window.width = 10;
      EACH_RENDERER(i) {
        const float *image = render(i, volume, &scene);
        size_t shown = 0;
        for (int p = 0; p < PIXELS; p++) {
          const float *c = image + 4 * p;
          if (!(c[3] == 0 ? c[0] == 0 : c[3] == 1 && fabsf(c[0] - 0.5f) < 1e-5f))
            fail_msg("%s: slab %d: grey %g of opacity %g", test_names[i], slab, (double)c[0], (double)c[3]);
          shown += c[3] == 1;
        }
        const double share = (double)shown / PIXELS;
        if (!(across ? share > 0.45 && share < 0.56 : share > 0.9))
          fail_msg("%s: slab %d, %s: %.3f of the picture shows", test_names[i], slab, across ? "axial" : "sagittal", share);
      }
    }
}

/* A label volume takes the gaps' place; without gaps nothing changes. */
TEST(the_plan_says_it) {
  tc_volume *gaps = make(ball), *none = make(test_waves);
  g_auto(tc_scene) scene;
  tc_explanation plan;
  look(&scene, gaps, TC_MODE_MIP);
  assert_true(tc_renderer_explain(test_renderers[SCALAR], gaps, &scene, NULL, &plan, NULL));
  assert_non_null(strstr(plan.kernel, ".gaps"));
  assert_true(tc_renderer_explain(test_renderers[SCALAR], none, &scene, NULL, &plan, NULL));
  assert_null(strstr(plan.kernel, ".gaps"));
  tc_volume_unref(gaps);
  tc_volume_unref(none);
}

TESTS(test_renderers_open, test_renderers_close)
