/* Neighbourhoods in registers, loads and gathers: variants of one instruction set draw the same bits, and light a volume as
 * the scalar kernel does. */
#include "tests/support/test.h"

#include <math.h>

#include "renderer/raycast/cpu/isa.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/image.h"

enum { TRIALS = 300 };
#define LIT_BOUND 1e-3 /* of colour; measured 1.3e-4; with one-sided differences along y counted once, .08 (AMD EPYC, AVX2 and AVX-512) */

/* Every second volume has single voxels that differ from their neighbours by more than 16 bits hold, if its type can. */
static double rough_waves(double x, double y, double z, const void *seed) {
  const double wavelength = 9;
  if (*(const unsigned *)seed % 2 && test_noise(z, x, y, seed) > 0.999) return 60000;
  return 100 * test_waves(x, y, z, &wavelength) + 20 * test_noise(x, y, z, seed);
}

static tc_volume *draw_volume(uint64_t *state) {
  const unsigned seed = (unsigned)*state;
  test_grid g = {.type = (tc_voxel_type)(TC_VOXEL_TYPE_COUNT * test_random(state))};
  for (int k = 0; k < 3; k++) {
    g.dims[k] = 3 + (int)(40 * test_random(state)); /* 3: too thin for a neighbourhood */
    g.spacing[k] = test_random(state) < 0.5 ? 1 : 0.4 + 2 * test_random(state);
  }
  if (test_random(state) < 0.2) { /* long, where positions are rounded most */
    const int axis = (int)(3 * test_random(state));
    for (int k = 0; k < 3; k++) g.dims[k] = k == axis ? 500 + (int)(9000 * test_random(state)) : 4 + g.dims[k] / 4;
  }
  return test_volume(&g, rough_waves, &seed);
}

/* Mostly near views, whose packets fit neighbourhoods, some along an axis or grazing a face. */
static void draw_scene(tc_scene *s, const tc_volume *volume, uint64_t *state) {
  const tc_knot knots[] = {{30, {1, 0.2, 0}, 0}, {70, {0, 1, 0.4}, 0.3}, {110, {0.3, 0.2, 1}, 0.05}};
  double side[3], near = test_random(state) < 0.2 ? 1 : 0.02 + 0.3 * test_random(state);
  test_scene(s, 45, 38);
  test_scene_knots(s, TC_KNOT_OPACITY, knots, 3);
  for (int k = 0; k < 3; k++) side[k] = test_random(state) < 0.2 ? 0.001 : test_random(state) - 0.5;
  test_scene_frame(s, volume, test_random(state) < 0.5 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
  s->camera.fov_y_deg *= near;
  s->camera.height_mm *= near;
  s->sampling.step = 0.2 + 1.5 * test_random(state);
  s->sampling.termination = test_random(state) < 0.5 ? 0 : 0.01;
  s->sampling.jitter = test_random(state) < 0.1;
  s->skipping.mode = test_random(state) < 0.5 ? TC_SKIPPING_AUTO : TC_SKIPPING_OFF;
  s->shading.model = test_random(state) < 0.6 ? TC_SHADING_BLINN_PHONG : TC_SHADING_NONE;
  s->shading.gradient = test_random(state) < 0.7 ? TC_GRADIENT_CENTRAL : TC_GRADIENT_CELL;
  if (test_random(state) < 0.3) s->mode = test_random(state) < 0.5 ? TC_MODE_MIP : TC_MODE_MINIP;
  if (test_random(state) < 0.3) s->classification = TC_PREINTEGRATED2; /* samples in the middle of segments, too */
}

static tc_renderer *open_variant(const char *isa) {
  const tc_renderer_options options = {.backend = TC_BACKEND_CPU, .isa = isa};
  g_autoptr(GError) error = NULL;
  tc_renderer *r = tc_renderer_new(&options, &error);
  if (!r && !strstr(error->message, "this processor does not support")) fail_msg("%s", error->message);
  return r;
}

enum { N_VARIANTS = 3 };
static const char *const names[N_VARIANTS] = {"avx512-load", "avx512-gather", "avx512"};

TEST(neighbourhoods_loads_and_gathers_draw_the_same_bits) {
  static const tc_render_request linear = {.want_linear = true};
  tc_renderer *variants[N_VARIANTS];
  tc_frame frames[N_VARIANTS] = {{0}};
  uint64_t state = 17, shown = 0;
  for (int i = 0; i < N_VARIANTS; i++) variants[i] = open_variant(names[i]);
  if (!variants[0]) skip();
  for (int trial = 0; trial < TRIALS; trial++) {
    g_autoptr(tc_volume) volume = draw_volume(&state);
    g_auto(tc_scene) scene;
    draw_scene(&scene, volume, &state);
    for (int i = 0; i < N_VARIANTS; i++) assert_true(tc_render(variants[i], volume, &scene, &linear, &frames[i], NULL));
    const size_t pixels = (size_t)scene.image.width * (size_t)scene.image.height;
    for (int i = 1; i < N_VARIANTS; i++)
      for (size_t p = 0; p < 4 * pixels; p++)
        if (memcmp(&frames[0].linear[p], &frames[i].linear[p], 4))
          fail_msg("trial %d: channel %zu of pixel %zu is %.9g with %s, %.9g with %s", trial, p % 4, p / 4,
                   (double)frames[0].linear[p], names[0], (double)frames[i].linear[p], names[i]);
    for (size_t p = 0; p < pixels; p++) shown += frames[0].linear[4 * p + 3] > 0;
  }
  printf("  %d scenes the same, %llu pixels shown\n", TRIALS, (unsigned long long)shown);
  assert_true(shown > TRIALS * 300);
  for (int i = 0; i < N_VARIANTS; i++) tc_frame_finish(&frames[i]), tc_renderer_free(variants[i]);
}

/* Whole volumes, whose surfaces reach the volume's faces, lit by central differences: the vectors' gradients in integers beside
 * the scalar kernel's in floats. */
TEST(vectors_light_faces_as_the_scalar_kernel_does) {
  enum { SCENES = 60, VECTORS = 3 };
  static const char *const isas[VECTORS] = {"avx2", "avx512-load", "avx512"};
  static const tc_render_request linear = {.want_linear = true};
  tc_renderer *scalar = open_variant("scalar");
  for (int i = 0; i < VECTORS; i++) {
    tc_renderer *vector = open_variant(isas[i]);
    tc_frame frames[2] = {{0}};
    uint64_t state = 29;
    double worst = 0;
    for (int trial = 0; vector && trial < SCENES; trial++) {
      g_autoptr(tc_volume) volume = draw_volume(&state);
      g_auto(tc_scene) scene;
      draw_scene(&scene, volume, &state);
      test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[]){0.4, -0.3, test_random(&state) - 0.5});
      scene.mode = TC_MODE_DVR;
      scene.sampling.termination = 0;
      scene.shading.model = TC_SHADING_BLINN_PHONG;
      scene.shading.gradient = TC_GRADIENT_CENTRAL;
      assert_true(tc_render(scalar, volume, &scene, &linear, &frames[0], NULL));
      assert_true(tc_render(vector, volume, &scene, &linear, &frames[1], NULL));
      const size_t pixels = (size_t)scene.image.width * (size_t)scene.image.height;
      worst = fmax(worst, test_compare(frames[0].linear, frames[1].linear, pixels).max);
    }
    printf("  %s: %.2g of 1 at most\n", isas[i], worst);
    assert_true(worst < LIT_BOUND);
    for (int k = 0; k < 2; k++) tc_frame_finish(&frames[k]);
    tc_renderer_free(vector);
  }
  tc_renderer_free(scalar);
}

#define ORDER_BOUND 1e-5 /* of colour; measured 1.2e-6 (AMD EPYC, Zen 3, AVX2) */

/* Front to back, steps within the volume load the cells that the step before has found, without clamping; back to front, every
 * sample is found and clamped on its own. The reference judges front to back in other tests. */
TEST(steps_within_the_volume_load_what_clamped_samples_do) {
  enum { SCENES = 60, ISAS = 4 };
  static const char *const isas[ISAS] = {"scalar", "avx2", "avx512-load", "avx512"};
  static const tc_render_request linear = {.want_linear = true};
  for (int i = 0; i < ISAS; i++) {
    tc_renderer *r = open_variant(isas[i]);
    tc_frame frames[2] = {{0}};
    uint64_t state = 41;
    double worst = 0;
    for (int trial = 0; r && trial < SCENES; trial++) {
      g_autoptr(tc_volume) volume = draw_volume(&state);
      g_auto(tc_scene) scene;
      draw_scene(&scene, volume, &state);
      scene.mode = TC_MODE_DVR;
      scene.sampling.termination = 0;
      if (trial % 3 == 0) scene.sampling.rays_per_pixel = 2 + trial % 4; /* samples between whole steps */
      for (int k = 0; k < 2; k++) {
        scene.order = k ? TC_BACK_TO_FRONT : TC_FRONT_TO_BACK;
        assert_true(tc_render(r, volume, &scene, &linear, &frames[k], NULL));
      }
      const size_t pixels = (size_t)scene.image.width * (size_t)scene.image.height;
      worst = fmax(worst, test_compare(frames[0].linear, frames[1].linear, pixels).max);
    }
    printf("  %s: %.2g of 1 at most\n", isas[i], worst);
    assert_true(worst < ORDER_BOUND);
    for (int k = 0; k < 2; k++) tc_frame_finish(&frames[k]);
    tc_renderer_free(r);
  }
}

/* The ray at a place in the picture: where it passes its anchor, and its direction, in voxels. */
static void ray_at(const tc_rays *r, double i, double j, double at[3], double along[3]) {
  double view[3], length = 0;
  for (int k = 0; k < 3; k++) {
    view[k] = r->view0[k] + i * r->view_du[k] + j * r->view_dv[k];
    at[k] = r->anchor0[k] + i * r->anchor_du[k] + j * r->anchor_dv[k];
    length += view[k] * view[k];
  }
  for (int k = 0; k < 3; k++) {
    along[k] = 0;
    for (int m = 0; m < 3; m++) along[k] += r->to_index[3 * k + m] * view[m] / sqrt(length);
  }
}

/* Mean number of neighbourhoods of the packet in the middle of the picture, from the places of its rays where the middle ray is
 * nearest to the volume's centre. */
static double neighbourhoods_of(const tc_rays *r, tc_voxel_type type) {
  double lo[3] = {1e9, 1e9, 1e9}, hi[3] = {-1e9, -1e9, -1e9}, at[3], along[3], s = 0, speed = 0, parts = 1;
  ray_at(r, r->width / 2.0, r->height / 2.0, at, along);
  for (int k = 0; k < 3; k++) s += ((r->lo[k] + r->hi[k]) / 2 - at[k]) * along[k], speed += along[k] * along[k];
  for (int pixel = 0; pixel < 16; pixel++) {
    ray_at(r, r->width / 2.0 + pixel % 4 - 1.5, r->height / 2.0 + pixel / 4 - 1.5, at, along);
    for (int k = 0; k < 3; k++) {
      const double p = at[k] + s / speed * along[k];
      lo[k] = fmin(lo[k], p), hi[k] = fmax(hi[k], p);
    }
  }
  for (int k = 0; k < 3; k++) {
    const double voxels = k == 0 && type != TC_F32 ? 8 : 4, width = hi[k] - lo[k];
    if (width > voxels - 2) parts *= (width + 1) / (voxels - 1);
  }
  return parts;
}

TEST(rays_are_close_where_a_packet_fits_a_neighbourhood) {
  uint64_t state = 53;
  int close = 0, distant = 0, wrong = 0;
  tc_volume *volumes[2] = {NULL, NULL};
  for (int trial = 0; trial < 2000; trial++) {
    const test_grid g = {.dims = {64, 50, 40}, .type = trial % 2 ? TC_F32 : TC_U8, .spacing = {1, 1.5, 0.5 + test_random(&state)}};
    const unsigned seed = 3;
    if (!volumes[trial % 2]) volumes[trial % 2] = test_volume(&g, rough_waves, &seed);
    g_auto(tc_scene) scene;
    const double near = 0.1 + test_random(&state), side[3] = {test_random(&state) - 0.5, test_random(&state) - 0.5, test_random(&state) - 0.5};
    test_scene(&scene, 8, 8);
    test_scene_frame(&scene, volumes[trial % 2], trial % 3 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC, side);
    scene.camera.fov_y_deg *= near;
    scene.camera.height_mm *= near;
    const int pixels = 32 + (int)(150 * test_random(&state));
    tc_rays rays;
    tc_rays_set_up(&rays, volumes[trial % 2], &scene, pixels, pixels);
    const double parts = neighbourhoods_of(&rays, g.type);
    if (fabs(parts - (double)TC_MOST_NEIGHBOURHOODS) < 0.1) continue; /* the rays of a packet are not quite parallel */
    const bool found = tc_cpu_rays_are_close(&rays, g.type);
    close += found, distant += !found;
    wrong += found != (parts <= (double)TC_MOST_NEIGHBOURHOODS);
  }
  printf("  %d close, %d distant, %d otherwise than the rays say\n", close, distant, wrong);
  assert_true(close > 300 && distant > 300 && wrong == 0);
  for (int i = 0; i < 2; i++) tc_volume_unref(volumes[i]);
}

TEST(distant_rays_of_linear_dvr_and_projections_get_their_own_variant) {
  const tc_cpu_isa near = {.name = "near"}, far = {.name = "far"};
  const tc_cpu_isas isas = {&near, &far};
  g_autoptr(tc_volume) volume = tc_volume_demo("vessels", NULL);
  g_auto(tc_scene) scene;
  test_scene(&scene, 64, 64);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[]){0.4, -0.3, 0.2});
  for (int large = 0; large < 2; large++) {
    tc_rays rays;
    tc_rays_set_up(&rays, volume, &scene, large ? 2048 : 64, large ? 2048 : 64);
    for (int mode = 0; mode < TC_MODE_COUNT; mode++)
      for (int cubic = 0; cubic < 2; cubic++) {
        const tc_plan_key key = {.mode = (uint8_t)mode, .filter = cubic ? TC_FILTER_CUBIC : TC_FILTER_LINEAR};
        const bool casts = mode == TC_MODE_DVR || mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE;
        assert_ptr_equal(tc_cpu_isa_for(&isas, &key, &rays), casts && !cubic && !large ? &far : &near);
      }
  }
}

/* The variants chosen are of the best instruction set, or of AVX2 for distant rays; a forced one draws everything. The plan names the
 * one that draws. */
TEST(the_fastest_variants_are_chosen_at_start) {
  tc_renderer *chosen = open_variant(NULL), *widest = open_variant("avx512");
  g_auto(GStrv) both = g_strsplit(tc_renderer_about(chosen)->isa, "; ", 2);
  bool known = !widest;
  printf("  chosen: %s\n", tc_renderer_about(chosen)->isa);
  for (int i = 0; i < N_VARIANTS; i++) known |= !strcmp(both[0], names[i]);
  assert_true(known && (!both[1] || g_str_has_suffix(both[1], " for distant rays")));
  g_autoptr(tc_volume) volume = tc_volume_demo("vessels", NULL);
  g_auto(tc_scene) scene;
  test_scene(&scene, 64, 64);
  test_scene_frame(&scene, volume, TC_PERSPECTIVE, (double[]){0.4, -0.3, 0.2});
  for (int large = 0; large < 2; large++) {
    tc_explanation plan;
    scene.image.width = scene.image.height = large ? 2048 : 64;
    assert_true(tc_renderer_explain(chosen, volume, &scene, NULL, &plan, NULL));
    const char *name = strrchr(plan.kernel, '.') + 1;
    assert_true(large || !both[1] ? !strcmp(name, both[0]) : g_str_has_prefix(both[1], name) && strcmp(name, both[0]));
  }
  tc_cpu_isas forced;
  assert_true(tc_cpu_isa_choose("scalar", &forced, NULL));
  assert_ptr_equal(forced.close, forced.distant);
  tc_renderer_free(chosen);
  tc_renderer_free(widest);
}

TESTS(NULL, NULL)
