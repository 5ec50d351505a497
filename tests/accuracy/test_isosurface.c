/* Isosurfaces: the reference against closed forms, every instruction set's and OpenGL's pictures and depths against
 * the reference, and what must not matter. */
#include "tests/support/test.h"

#include "renderer/quality/quality.h"
#include "renderer/raycast/rays.h"
#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"
#include "tests/support/renderers.h"

enum { SIDE = 48, PIXELS = SIDE * SIDE };

static tc_frame *render(int which, tc_volume *volume, const tc_scene *scene, tc_explanation *plan) {
  const tc_render_request request = {.want_linear = true, .want_depth = true};
  return test_draw(which, volume, scene, &request, plan);
}

static tc_reference *reference(tc_volume *volume, const tc_scene *scene) {
  GError *error = NULL;
  tc_reference *r = tc_reference_new(volume, scene, SIDE, SIDE, 0, &error);
  if (!r) fail_msg("%s", error->message);
  return r;
}

static void surface_scene(tc_scene *scene, const tc_volume *volume, double value) {
  test_scene(scene, SIDE, SIDE);
  test_scene_frame(scene, volume, TC_PERSPECTIVE, (double[3]){1, -0.6, 0.4});
  scene->mode = TC_MODE_ISOSURFACE;
  scene->isosurface.value = value;
  scene->shading.model = TC_SHADING_BLINN_PHONG;
}

/* A view along +y through (x, z), one ray in the middle. */
static void look_along_y(tc_scene *scene, double x, double z) {
  test_scene_look(scene, TC_ORTHOGRAPHIC, (double[3]){x, -50, z}, (double[3]){x, 0, z}, 4);
}

static tc_volume *waves(tc_voxel_type type) {
  /* integer voxels store 0..1 in steps of 1/100: plateaus, and voxels that are the value itself */
  return test_volume(&(test_grid){.dims = {24, 20, 22}, .type = type, .slope = type == TC_F32 ? 1 : 0.01,
                                  .spacing = {1, 1.5, 0.7}}, test_waves, &(double){14});
}

/* ---- the reference ---- */

static bool middle_hit(tc_volume *volume, const tc_scene *scene, tc_reference_hit *hit) {
  g_autoptr(tc_reference) r = reference(volume, scene);
  bool met = tc_reference_surface(r, SIDE / 2.0, SIDE / 2.0, hit);
  return met;
}

TEST(reference_meets_closed_forms) {
  const double slant[4] = {0.3, 1, -0.2, 2};
  tc_volume *plane = test_volume(&(test_grid){.dims = {9, 9, 9}, .type = TC_F32}, test_linear, slant);
  g_auto(tc_scene) scene;
  tc_reference_hit hit;
  surface_scene(&scene, plane, 7.25);
  look_along_y(&scene, 4.3, 3.1);
  assert_true(middle_hit(plane, &scene, &hit));
  double y = 7.25 - 2 - 0.3 * 4.3 + 0.2 * 3.1, length = sqrt(0.09 + 1 + 0.04);
  assert_true(fabs(hit.distance_mm - (50 + y)) < 1e-6 && fabs(hit.position[1] - y) < 1e-6);
  for (int k = 0; k < 3; k++) assert_true(fabs(hit.normal[k] + slant[k] / length) < 1e-6);
  tc_volume_unref(plane);

  /* One cell, several roots. */
  g_autoptr(tc_volume) cell = test_volume(&(test_grid){.dims = {2, 2, 2}, .type = TC_F32}, test_noise, &(unsigned){3});
  uint64_t seed = 5;
  int grazed = 0;
  for (int n = 0; n < 200; n++) {
    double from[3], to[3], value = test_random(&seed), before = 0;
    for (int k = 0; k < 3; k++) from[k] = test_random(&seed), to[k] = test_random(&seed);
    for (int k = 0; k < 3; k++) from[k] -= 3 * (to[k] - from[k]), to[k] += from[k];
    scene.isosurface.value = value;
    test_scene_look(&scene, TC_PERSPECTIVE, from, to, 20);
    tc_reference *r = reference(cell, &scene);
    bool met = tc_reference_surface(r, SIDE / 2.0, SIDE / 2.0, &hit), crossed = false, known = false;
    tc_reference_free(r);
    /* walked in small steps by the volume's own interpolation */
    double d[3], norm = 0, at[3], f, distance = 0;
    for (int k = 0; k < 3; k++) d[k] = to[k] - from[k], norm += d[k] * d[k];
    for (int i = 0; i < 40000 && !crossed; i++) {
      for (int k = 0; k < 3; k++) at[k] = from[k] + d[k] / sqrt(norm) * i * 2e-4;
      if (!tc_volume_value_at(cell, at, &f)) continue;
      crossed = known && (before >= value) != (f >= value);
      known = true;
      before = f;
      distance = i * 2e-4;
    }
    /* in and out within a step */
    if (met != crossed || (met && !(fabs(hit.distance_mm - distance) < 2.1e-4))) grazed++;
  }
  assert_true(grazed <= 2);
}

/* ---- depths and pictures ---- */

typedef struct verdict {
  double depth, color; /* largest error but for ties */
  size_t ties, seen;
} verdict;

/* A tie: the hit is there for one only, or is another fold of the surface. */
static void judge(int which, tc_volume *volume, const tc_scene *scene, verdict *v) {
  tc_frame *f = render(which, volume, scene, NULL);
  g_autoptr(tc_reference) r = reference(volume, scene);
  for (int p = 0; p < PIXELS; p++) {
    tc_reference_hit hit = {.distance_mm = INFINITY};
    double rgba[4] = {0}, off = 0;
    bool met = tc_reference_surface(r, p % SIDE + 0.5, p / SIDE + 0.5, &hit);
    if (met) memcpy(rgba, hit.color, sizeof hit.color), rgba[3] = 1;
    const float *c = f->linear + 4 * p;
    v->seen += met;
    bool tie = met != (c[3] > 0);
    for (int k = 0; k < 4; k++) {
      assert_true(isfinite(c[k]) && c[k] >= 0 && c[k] <= c[3] && (c[3] == 0 || c[3] == 1));
      off = fmax(off, fabs((double)c[k] - rgba[k]));
    }
    assert_true(isinf(f->depth[p]) == (c[3] == 0));
    if (!tie && met) {
      double apart = fabs((double)f->depth[p] - hit.distance_mm);
      tie = apart > 0.01;
      if (!tie) v->depth = fmax(v->depth, apart);
    }
    tie = tie || off > 1.0 / 255;
    v->ties += tie;
    if (!tie) v->color = fmax(v->color, off);
  }
}

TEST(everyone_meets_the_reference) {
  verdict v[RENDERERS] = {{0}};
  for (int type = 0; type < TC_VOXEL_TYPE_COUNT; type++)
    for (int bits = 0; bits < 8; bits++) {
      g_autoptr(tc_volume) volume = waves((tc_voxel_type)type);
      g_auto(tc_scene) scene;
      surface_scene(&scene, volume, bits & 1 ? 0.5 : 0.683);
      scene.shading.model = (tc_shading_model)(bits % TC_SHADING_COUNT);
      scene.shading.gradient = (tc_gradient)((bits + type) % TC_GRADIENT_COUNT);
      if (bits & 2) scene.camera.projection = TC_ORTHOGRAPHIC, scene.camera.height_mm = 40;
      if (bits & 4) {
        scene.clip.n_planes = 1;
        memcpy(scene.clip.planes[0], (double[4]){-1, 0.3, 0, 11}, sizeof scene.clip.planes[0]);
        scene.image.linear_light = bits & 1;
      }
      /* in the midst */
      if (bits == 3) memcpy(scene.camera.position, (double[3]){12, 14, 8}, sizeof scene.camera.position);
      EACH_RENDERER(i) judge(i, volume, &scene, &v[i]);
    }
  EACH_RENDERER(i) {
    printf("  %s: depth within %.1e mm, colour within %.1e, %zu ties of %zu hits\n", test_names[i], v[i].depth,
           v[i].color, v[i].ties, v[i].seen);
    assert_true(v[i].depth < 2e-3 && v[i].seen > 10000 && (double)v[i].ties < 2e-3 * (double)v[i].seen);
  }
}

/* ---- what must not matter ---- */

TEST(skipping_changes_no_bit) {
  const double center[3] = {20, 25, 15};
  uint64_t leaps = 0;
  for (int n = 0; n < 12; n++) {
    bool noise = n % 3 == 2;
    tc_volume *volume = test_volume(&(test_grid){.dims = {40, 50, 30}, .type = (tc_voxel_type)(n % TC_VOXEL_TYPE_COUNT),
                                                 .slope = n % 2 ? -1 : 1, .intercept = 3},
                                    test_radius2, center);
    if (noise) {
      tc_volume_unref(volume);
      volume = test_volume(&(test_grid){.dims = {31, 7, 26}, .type = TC_U8, .slope = 0.01}, test_noise, &(unsigned){9});
    }
    g_auto(tc_scene) scene;
    surface_scene(&scene, volume, noise ? 0.97 : n % 2 ? -60 : 90);
    scene.skipping.block = 2 + n % 5;
    if (n > 5) scene.camera.projection = TC_ORTHOGRAPHIC;
    if (n == 4) look_along_y(&scene, 20, 15), scene.camera.height_mm = 40; /* rays along faces and edges */
    EACH_RENDERER(i) {
      scene.skipping.mode = TC_SKIPPING_AUTO;
      tc_frame *f = render(i, volume, &scene, NULL);
      g_autofree float *linear = g_memdup2(f->linear, sizeof(float) * 4 * PIXELS);
      g_autofree float *depth = g_memdup2(f->depth, sizeof(float) * PIXELS);
      leaps += f->stats.leaps;
      scene.skipping.mode = TC_SKIPPING_OFF;
      render(i, volume, &scene, NULL);
      assert_memory_equal(linear, test_frames[i].linear, sizeof(float) * 4 * PIXELS);
      assert_memory_equal(depth, test_frames[i].depth, sizeof(float) * PIXELS);
    }
    tc_volume_unref(volume);
  }
  assert_true(leaps > 1000);
}

/* A sheet thinner than a voxel that no step of 1 would meet. */
static double sheet(double x, double y, double z, const void *context) { return y == 11 ? 1 : 0; }

TEST(nothing_thin_is_missed) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {20, 24, 20}, .type = TC_F32}, sheet, NULL);
  g_auto(tc_scene) scene;
  surface_scene(&scene, volume, 0.999);
  test_scene_look(&scene, TC_PERSPECTIVE, (double[3]){9.5, -40.3, 9.5}, (double[3]){9.5, 0, 9.5}, 8);
  scene.sampling.step = 5; /* not read */
  EACH_RENDERER(i) {
    tc_frame *f = render(i, volume, &scene, NULL);
    for (int p = 0; p < PIXELS; p++) assert_true(f->linear[4 * p + 3] == 1);
    assert_true(fabs((double)f->depth[PIXELS / 2 + SIDE / 2] - (40.3 + 10.999)) < 0.01);
  }
}

/* Everything of one side, or a value that the volume does not have, is an empty picture. */
TEST(extremes_are_empty_or_right) {
  const int sizes[][3] = {{1, 1, 1}, {1, 9, 1}, {9, 1, 5}, {2, 2, 2}, {1, 1, 300}};
  const double along[4] = {0.1, 0.1, 0.1, 0}, whole = 5, tiny[4] = {1e-30, 1e-30, 0, 0},
               huge[4] = {1e29, 3e28, 0, -1e29};
  const struct { test_field field; const void *context; double value; int empty; } cases[] = {
      {test_constant, &whole, 5, 1}, {test_constant, &whole, 6, 1}, {test_linear, along, 1e9, 1},
      {test_linear, along, -1, 1},   {test_linear, along, 0, 1},    {test_linear, along, 0.25, 0},
      {test_linear, tiny, 2e-30, 0}, {test_linear, huge, 1e28, 0}};
  for (size_t s = 0; s < G_N_ELEMENTS(sizes); s++)
    for (size_t n = 0; n < G_N_ELEMENTS(cases); n++) {
      test_grid grid = {.dims = {sizes[s][0], sizes[s][1], sizes[s][2]}, .type = TC_F32, .spacing = {1, 2, 0.5}};
      g_autoptr(tc_volume) volume = test_volume(&grid, cases[n].field, cases[n].context);
      g_auto(tc_scene) scene;
      tc_explanation plan;
      surface_scene(&scene, volume, cases[n].value);
      EACH_RENDERER(i) {
        tc_frame *f = render(i, volume, &scene, &plan);
        size_t seen = 0;
        for (int p = 0; p < PIXELS * 4; p++) {
          assert_true(isfinite(f->linear[p]) && f->linear[p] >= 0 && f->linear[p] <= 1);
          seen += f->linear[p] > 0;
        }
        if (cases[n].empty) {
          assert_true(seen == 0 && !plan.stages[TC_STAGE_GRADIENT].included);
          assert_non_null(strstr(plan.stages[TC_STAGE_GRADIENT].reason, "empty picture"));
        }
      }
      verdict v = {0};
      if (!cases[n].empty) judge(SCALAR, volume, &scene, &v);
      assert_true(v.ties <= 8);
    }
}

/* Each pixel is the mean of the reference's hits at its rays' places, and its depth the least of them. */
/* Along an axis of one voxel nothing changes and no wall is passed, wherever a ray crosses it. */
TEST(single_voxels_are_thick) {
  const double rise[4] = {0.1, 0, 0, 0};
  g_autoptr(tc_volume) volume =
      test_volume(&(test_grid){.dims = {8, 1, 1}, .type = TC_F32, .spacing = {1, 20, 20}}, test_linear, rise);
  for (int bits = 0; bits < 8; bits++) {
    g_auto(tc_scene) scene;
    surface_scene(&scene, volume, 0.03);
    scene.skipping.mode = bits & 1 ? TC_SKIPPING_OFF : TC_SKIPPING_AUTO;
    scene.skipping.block = 2;
    test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){60, bits & 2 ? 70 : -70, bits & 4 ? 80 : -80},
                    (double[3]){3.5, 0, 0}, 40);
    EACH_RENDERER(i) {
      verdict v = {0};
      judge(i, volume, &scene, &v);
      if (v.seen < 100 || v.ties > 8)
        fail_msg("%s, %d: %zu of %zu hits are missed", test_names[i], bits, v.ties, v.seen);
    }
  }
}

TEST(several_rays_are_their_mean) {
  enum { COUNT = 8 };
  g_autoptr(tc_volume) volume = waves(TC_I16);
  g_auto(tc_scene) scene;
  tc_explanation plan;
  tc_rays rays;
  surface_scene(&scene, volume, 0.683);
  scene.sampling.rays_per_pixel = COUNT;
  scene.sampling.coherence = true;
  tc_rays_set_up(&rays, volume, &scene, SIDE, SIDE);
  g_autoptr(tc_reference) r = reference(volume, &scene);
  EACH_RENDERER(i) {
    tc_frame *f = render(i, volume, &scene, &plan);
    size_t ties = 0, edges = 0;
    assert_true(plan.stages[TC_STAGE_RAYS].included && !plan.stages[TC_STAGE_COHERENCE].included);
    for (int p = 0; p < PIXELS; p++) {
      double mean[4] = {0}, nearest = INFINITY, off = 0;
      for (int n = 0; n < COUNT; n++) {
        tc_reference_hit hit;
        double x = p % SIDE + 0.5 + rays.of_pixel[n].x, y = p / SIDE + 0.5 + rays.of_pixel[n].y;
        if (!tc_reference_surface(r, x, y, &hit)) continue;
        for (int k = 0; k < 3; k++) mean[k] += hit.color[k] / COUNT;
        mean[3] += 1.0 / COUNT;
        nearest = fmin(nearest, hit.distance_mm);
      }
      for (int k = 0; k < 4; k++) off = fmax(off, fabs((double)f->linear[4 * p + k] - mean[k]));
      bool near = isinf(nearest) ? isinf(f->depth[p]) : fabs((double)f->depth[p] - nearest) < 2e-3;
      ties += off > 1e-4 || !near;
      edges += mean[3] > 0 && mean[3] < 1;
    }
    printf("  %s: %zu ties, %zu edges\n", test_names[i], ties, edges);
    assert_true(ties <= 4 && edges > 50);
  }
}

TEST(plans_say_what_is_read) {
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  tc_explanation plan;
  GError *error = NULL;
  surface_scene(&scene, volume, 0.5);
  scene.transfer_function.count = 0; /* neither is read */
  scene.window.width = -1;
  render(SCALAR, volume, &scene, &plan);
  assert_string_equal(plan.kernel, "isosurface.linear.shaded.u8.scalar");
  assert_false(plan.stages[TC_STAGE_TABLE_2D].included || plan.stages[TC_STAGE_TERMINATION].included);
  assert_true(plan.stages[TC_STAGE_SKIPPING].included && plan.stages[TC_STAGE_SKIPPING].bytes > 0);
  assert_true(plan.stages[TC_STAGE_DEPTH].included && test_frames[SCALAR].stats.tables_ms == 0);
  scene.camera.position[0] += 3; /* the camera rebuilds nothing */
  render(SCALAR, volume, &scene, &plan);
  assert_true(test_frames[SCALAR].stats.skip_ms == 0);
  scene.shading.model = TC_SHADING_NONE;
  render(SCALAR, volume, &scene, &plan);
  assert_false(plan.stages[TC_STAGE_GRADIENT].included);
  strcpy(scene.labels.volume, "segments"); /* shown in dvr and mpr only; no steps to jitter or to choose */
  scene.sampling.jitter = true;
  scene.quality.max_error = 0.01;
  assert_true(tc_explain(volume, &scene, SIDE, SIDE, &plan, &error));
  assert_true(!plan.key.labels && !plan.key.jitter && strstr(plan.stages[TC_STAGE_JITTER].reason, "no segments"));
  assert_non_null(strstr(plan.stages[TC_STAGE_LABELS].reason, "mode isosurface"));
  char reason[96];
  assert_true(tc_quality_refuses(&scene, reason, sizeof reason) && strstr(reason, "no steps"));
  scene.quality.max_error = 0;
  scene.sampling.rays_per_pixel = 65;
  assert_false(tc_explain(volume, &scene, SIDE, SIDE, &plan, &error));
  assert_string_equal(tc_error_pointer(error), "/sampling/raysPerPixel");
  g_clear_error(&error);
  scene.sampling.rays_per_pixel = 1;
  scene.isosurface.value = NAN;
  assert_false(tc_explain(volume, &scene, SIDE, SIDE, &plan, &error));
  assert_string_equal(tc_error_pointer(error), "/isosurface/value");
  g_clear_error(&error);
  scene.isosurface.value = 0.5;
  scene.filter = TC_FILTER_NEAREST;
  assert_false(tc_explain(volume, &scene, SIDE, SIDE, &plan, &error));
  assert_string_equal(tc_error_pointer(error), "/filter");
  g_clear_error(&error);
}

/* What an object costs in a mode is the plan's rate times a factor of this renderer, the same for all its scenes; rays cost
 * scalar kernels more than the widest vectors, splats do not. */
TEST(costs_are_this_renderers) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_U8, .slope = 0.004}, test_waves, &(double){24});
  double rays_to_splats[2];
  for (int i = 0; i < 2; i++) {
    double speed[2][TC_OBJECT_MODES];
    for (int zoomed = 0; zoomed < 2; zoomed++) {
      g_auto(tc_scene) scene;
      tc_explanation plan;
      tc_object_cost rates;
      test_scene(&scene, 64, 64);
      test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[3]){1, -0.6, 0.4});
      scene.mode = TC_MODE_ISOSURFACE, scene.isosurface.value = zoomed ? 0.5 : 0.6;
      int calls = 0;
      do
        assert_true(tc_renderer_explain(test_renderers[i ? test_widest() : SCALAR], volume, &scene, NULL, &plan, NULL));
      while (!plan.object_measured && ++calls < 100);
      assert_true(plan.object_measured && (zoomed ? calls == 0 : i || calls > 0)); /* in pieces (scalar ones are slow), and once */
      assert_true(plan.has_object && tc_object_cost_of(volume, &scene, 64, 64, NULL, &rates));
      for (int m = 0; m < TC_OBJECT_MODES; m++)
        speed[zoomed][m] = plan.object.ms[m] / rates.ms[m];
    }
    for (int m = 0; m < TC_OBJECT_MODES; m++)
      assert_true(speed[0][m] > 0 && fabs(speed[1][m] / speed[0][m] - 1) < 1e-9);
    rays_to_splats[i] = speed[0][TC_OBJECT_ISOSURFACE] / speed[0][TC_OBJECT_SPLAT];
    printf("  %s: splats %.2f, rays %.2f, triangles %.2f of the rates\n", test_names[i ? test_widest() : SCALAR],
           speed[0][TC_OBJECT_SPLAT], speed[0][TC_OBJECT_ISOSURFACE], speed[0][TC_OBJECT_MESH]);
  }
  assert_true(test_widest() == SCALAR || rays_to_splats[0] > 1.2 * rays_to_splats[1]);
}

TESTS(test_renderers_open, test_renderers_close)
