/* Mode splat on the gl back end against the cpu's splatter: the same sums of whole numbers, but where a pixel's middle lies
 * at a footprint's or a core's rim, or between two steps of the footprint's table, within rounding. */
#include "tests/support/splats.h"

#include "renderer/tomocast.h"
#include "tests/support/renderers.h"

enum { WIDE = SANITIZED ? 160 : 300, PIXELS = WIDE * WIDE };
static tc_volume *waves(void) {
  return test_volume(&(test_grid){.dims = {60, 52, 56}, .type = TC_U8, .slope = 0.004, .spacing = {1, 1.3, 0.8},
                                  .origin = {-1000, 300, 50}}, test_waves, &(double){24});
}

static void splat_scene(tc_scene *scene, const tc_volume *volume, tc_projection projection) {
  test_scene(scene, WIDE, WIDE);
  test_scene_frame(scene, volume, projection, (double[3]){1, -0.6, 0.4});
  scene->mode = TC_MODE_SPLAT;
  scene->splat.threshold[0] = 0.55, scene->splat.threshold[1] = 2;
  scene->shading.model = TC_SHADING_BLINN_PHONG;
}

/* Pixels that differ by more than 1/255; the others' depths are the same within single precision. */
static int count_apart(const tc_frame *cpu, const tc_frame *gl, int *seen) {
  int over = 0, deep = 0;
  double most = 0;
  *seen = 0;
  for (int i = 0; i < PIXELS; i++) {
    const double worst = test_pixel_off(gl->linear, cpu->linear, (size_t)i);
    int level = 0;
    for (int c = 4 * i; c < 4 * i + 4; c++) level = MAX(level, abs(gl->rgba[c] - cpu->rgba[c]));
    *seen += cpu->linear[4 * i + 3] > 0;
    over += worst > 1.0 / 255 || level > 1;
    most = fmax(most, worst);
    deep += isfinite(cpu->depth[i]) != isfinite(gl->depth[i]) ||
            (isfinite(cpu->depth[i]) && fabsf(cpu->depth[i] - gl->depth[i]) > 1e-3f);
  }
  printf("  %d pixels show something: %d off by more than 1/255 (at most %.3f), %d by more than 1 um in depth\n", *seen, over,
         most, deep);
  return MAX(over, deep);
}

static void expect_equal(tc_volume *volume, tc_volume *labels, const tc_scene *scene) {
  const tc_render_request request = {.want_linear = true, .want_depth = true, .labels = labels};
  tc_explanation plan;
  int seen;
  const tc_frame *cpu = test_draw(test_widest(), volume, scene, &request, NULL);
  const tc_frame *gl = test_draw(GL, volume, scene, &request, &plan);
  assert_non_null(strstr(plan.kernel, ".gl"));
  const int apart = count_apart(cpu, gl, &seen);
  assert_true(apart <= seen / 1000 && seen > PIXELS / 20);
}

TEST(pictures_are_equal_but_for_rims) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) volume = waves();
  for (int round = 0; round < 7; round++) {
    g_auto(tc_scene) scene;
    splat_scene(&scene, volume, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.shading.model = (tc_shading_model[]){TC_SHADING_BLINN_PHONG, TC_SHADING_GOOCH, TC_SHADING_LAMBERT, 0}[round / 2 % 4];
    if (round == 1) scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -330, scene.clip.n_planes = 1;
    if (round == 2) {
      scene.clip.has_box = true;
      const double box[2][3] = {{-985, 320, 60}, {-950, 360, 85}};
      memcpy(scene.clip.box, box, sizeof box);
    }
    if (round == 3) scene.splat.kernel_radius = 2.5;
    if (round == 4) /* from the inside */
      test_scene_look(&scene, TC_PERSPECTIVE, (double[3]){-970, 335, 75}, (double[3]){-900, 380, 100}, 80);
    if (round == 5) scene.image.linear_light = scene.image.transparent = true;
    expect_equal(volume, NULL, &scene);
  }
}

/* Thin lines and their ends, in voxels of many pixels. */
TEST(lines_are_the_cpus) {
  needs(test_renderers[GL]);
  for (int round = 0; round < 4; round++) {
    g_autoptr(tc_volume) volume = test_volume(round & 1 ? &flat_grid : &cube, tubes, &(double){round < 2 ? 0.6 : 0.9});
    g_auto(tc_scene) scene;
    splat_scene(&scene, volume, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.camera.height_mm /= 2.2, scene.camera.fov_y_deg /= 2.2;
    scene.splat.threshold[0] = 0;
    expect_equal(volume, NULL, &scene);
  }
}

static double bands(double x, double y, double z, const void *wavelength) {
  const double wave = test_waves(x, y, z, wavelength);
  return wave < 0.55 ? 0 : 1 + floor(4 * (wave - 0.55) / 0.45);
}

/* Whether covered pixels differ by more than light alone makes them differ here. */
static bool is_colored(const tc_frame *frame) {
  const uint8_t *first = NULL;
  for (int i = 0; i < PIXELS; i++) {
    const uint8_t *p = frame->rgba + 4 * i;
    if (!(frame->linear[4 * i + 3] >= 1)) continue;
    if (!first) first = p;
    if (abs(p[0] - first[0]) + abs(p[1] - first[1]) + abs(p[2] - first[2]) > 60) return true;
  }
  return false;
}

/* By value and transfer function, by labels, and by a model's attribute and palette; unlit, lit, and cut. */
TEST(colors_are_the_cpus) {
  needs(test_renderers[GL]);
  const test_grid grid = {.dims = {60, 52, 56}, .type = TC_U8, .slope = 1, .spacing = {1, 1.3, 0.8}, .origin = {-1000, 300, 50}};
  tc_volume *volume = waves(), *labels = test_volume(&grid, bands, &(double){24});
  const tc_vmd_options wish = {1, 9, .labels = true, .attributes = "label"};
  g_autoptr(tc_volume) model = tc_vmd_volume(tc_vmd_of_volume(labels, &wish, NULL, NULL), NULL);
  for (int round = 0; round < 6; round++) {
    g_auto(tc_scene) scene;
    const int way = round % 3;
    splat_scene(&scene, volume, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    if (round < 3) scene.shading.model = TC_SHADING_NONE;
    if (round >= 3) scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -330, scene.clip.n_planes = 1;
    if (way == 0) strcpy(scene.splat.attribute, "value");
    if (way == 1) strcpy(scene.labels.volume, "labels");
    if (way == 2) strcpy(scene.splat.attribute, "label"), scene.splat.threshold[1] = 9;
    expect_equal(way == 2 ? model : volume, way == 1 ? labels : NULL, &scene);
    assert_true(is_colored(&test_frames[GL]));
  }
  tc_volume_unref(labels);
  tc_volume_unref(volume);
}

TEST(culling_changes_no_bit) {
  needs(test_renderers[GL]);
  g_autoptr(tc_volume) volume = waves();
  g_auto(tc_scene) scene;
  splat_scene(&scene, volume, TC_PERSPECTIVE);
  scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -330, scene.clip.n_planes = 1;
  const tc_frame *frame = test_draw(GL, volume, &scene, NULL, NULL);
  g_autofree float *culled = g_memdup2(frame->linear, PIXELS * 4 * sizeof *culled);
  const uint64_t samples = frame->stats.samples;
  scene.splat.culling = false;
  frame = test_draw(GL, volume, &scene, NULL, NULL);
  printf("  splats: %.0f, all %.0f\n", (double)samples, (double)frame->stats.samples);
  assert_memory_equal(frame->linear, culled, PIXELS * 4 * sizeof *culled);
  assert_true(frame->stats.samples > samples);
}

/* A haze and a nearly solid one, lit and not, by values, labels and palette, cut, and from the inside. */
TEST(translucent_sheets_are_the_cpus) {
  needs(test_renderers[GL]);
  const test_grid grid = {.dims = {60, 52, 56}, .type = TC_U8, .slope = 1, .spacing = {1, 1.3, 0.8}, .origin = {-1000, 300, 50}};
  tc_volume *volume = waves(), *labels = test_volume(&grid, bands, &(double){24});
  const tc_vmd_options wish = {1, 9, .labels = true, .attributes = "label"};
  g_autoptr(tc_volume) model = tc_vmd_volume(tc_vmd_of_volume(labels, &wish, NULL, NULL), NULL);
  for (int round = 0; round < 5; round++) {
    g_auto(tc_scene) scene;
    splat_scene(&scene, volume, round & 1 ? TC_PERSPECTIVE : TC_ORTHOGRAPHIC);
    scene.splat.opaque = false;
    tc_transfer_function *tf = &scene.transfer_function;
    for (size_t i = 0; i < tf->count && round == 0; i++) tf->points[i].value *= 0.05;
    if (round >= 2) scene.shading.model = TC_SHADING_NONE;
    if (round == 0) scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -330, scene.clip.n_planes = 1;
    if (round == 1) strcpy(scene.splat.attribute, "value");
    if (round == 2) strcpy(scene.labels.volume, "labels");
    if (round == 3) strcpy(scene.splat.attribute, "label"), scene.splat.threshold[1] = 9;
    if (round == 4)
      test_scene_look(&scene, TC_PERSPECTIVE, (double[3]){-970, 335, 75}, (double[3]){-900, 380, 100}, 80);
    expect_equal(round == 3 ? model : volume, round == 2 ? labels : NULL, &scene);
  }
  tc_volume_unref(labels);
  tc_volume_unref(volume);
}

static void stop_and_go_on(bool opaque) {
  g_autoptr(tc_volume) volume = waves();
  g_auto(tc_scene) scene;
  splat_scene(&scene, volume, TC_PERSPECTIVE);
  scene.splat.opaque = opaque;
  assert_true(test_resumes(GL, volume, &scene) >= 2); /* four tiles */
}

TEST(frames_stop_and_go_on_to_the_same_picture) {
  needs(test_renderers[GL]);
  stop_and_go_on(true);
  stop_and_go_on(false);
}

TESTS(test_renderers_open, test_renderers_close)
