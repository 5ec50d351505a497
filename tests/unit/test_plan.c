/* The render plan: what is refused and where it points, what is in and out and why, and what a change rebuilds. */
#include "tests/support/test.h"

#include "renderer/tomocast.h"
#include "tests/support/scoped.h"

typedef struct fixture {
  tc_volume *volume;
  tc_scene scene;
  tc_renderer *renderer;
  tc_frame frame;
  tc_explanation plan;
} fixture;

static int set_up(void **state) {
  fixture *f = g_new0(fixture, 1);
  tc_renderer_options o = {.backend = TC_BACKEND_CPU, .threads = 2};
  f->volume = tc_volume_demo("bucky", NULL);
  f->renderer = tc_renderer_new(&o, NULL);
  tc_scene_init(&f->scene);
  tc_scene_fit(&f->scene, f->volume);
  f->scene.image.width = f->scene.image.height = 48;
  *state = f;
  return f->volume && f->renderer ? 0 : -1;
}

static int tear_down(void **state) {
  fixture *f = *state;
  tc_frame_finish(&f->frame);
  tc_scene_clear(&f->scene);
  tc_renderer_free(f->renderer);
  tc_volume_unref(f->volume);
  g_free(f);
  return 0;
}

static void expect(fixture *f, tc_error_code code, const char *pointer) {
  GError *error = NULL;
  bool good = tc_explain(f->volume, &f->scene, f->scene.image.width, f->scene.image.height, &f->plan, &error);
  if (good) fail_msg("%s was accepted", pointer);
  if (error->code != (int)code || !tc_error_pointer(error) || strcmp(tc_error_pointer(error), pointer))
    fail_msg("wanted %d at %s, got %d at %s: %s", code, pointer, error->code, tc_error_pointer(error), error->message);
  g_error_free(error);
  /* The renderer refuses alike and goes on. */
  assert_false(tc_render(f->renderer, f->volume, &f->scene, NULL, &f->frame, NULL));
}

/* One value everywhere has no range to fit a window or a transfer function to: a scene is found all the same. */
TEST(constant_volumes_get_a_scene) {
  static const float values[] = {0, 5, -3, 1.1f, 1e-38f, 1e20f, -1e30f, 3e38f};
  for (size_t i = 0; i < G_N_ELEMENTS(values); i++) {
    const tc_volume_desc d = {.dims = {3, 3, 3}, .type = TC_F32, .spacing = {1, 1, 1}, .slope = 1,
                              .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
    tc_scene scene;
    tc_explanation plan;
    GError *error = NULL;
    for (int k = 0; k < 27; k++)
      ((float *)tc_volume_voxels(v))[k] = values[i];
    tc_volume_seal(v);
    for (int mode = TC_MODE_DVR; mode <= TC_MODE_MIP; mode++) {
      tc_scene_init(&scene);
      tc_scene_fit(&scene, v);
      scene.mode = (tc_mode)mode;
      if (!tc_explain(v, &scene, 32, 32, &plan, &error)) fail_msg("%g: %s", (double)values[i], error->message);
      tc_scene_clear(&scene);
    }
  }
}

TEST_WITH(nonsense_points_at_the_member, set_up, tear_down) {
  fixture *f = *state;
  const tc_camera camera = f->scene.camera;
  f->scene.camera.position[1] = NAN;
  expect(f, TC_ERROR_INVALID, "/camera/position");
  f->scene.camera = camera;
  f->scene.camera.target[0] = INFINITY;
  expect(f, TC_ERROR_INVALID, "/camera/target");
  f->scene.camera = camera;
  memcpy(f->scene.camera.position, camera.target, sizeof camera.target);
  expect(f, TC_ERROR_INVALID, "/camera/target");
  f->scene.camera = camera;
  memset(f->scene.camera.up, 0, sizeof camera.up);
  expect(f, TC_ERROR_INVALID, "/camera/up");
  for (int k = 0; k < 3; k++) f->scene.camera.up[k] = 2 * (camera.target[k] - camera.position[k]);
  expect(f, TC_ERROR_INVALID, "/camera/up");
  f->scene.camera = camera;
  f->scene.camera.fov_y_deg = 180;
  expect(f, TC_ERROR_INVALID, "/camera/fovY");
  f->scene.camera = camera;
  f->scene.camera.projection = TC_ORTHOGRAPHIC;
  f->scene.camera.height_mm = 0;
  expect(f, TC_ERROR_INVALID, "/camera/height");
  f->scene.camera = camera;
  f->scene.sampling.step = 0;
  expect(f, TC_ERROR_INVALID, "/sampling/step");
  f->scene.sampling.step = 1e-7;
  expect(f, TC_ERROR_LIMIT, "/sampling/step");
  f->scene.sampling.step = 1;
  f->scene.sampling.termination = 1;
  expect(f, TC_ERROR_INVALID, "/sampling/termination");
  f->scene.sampling.termination = 0;
  f->scene.transfer_function.points[1].value = f->scene.transfer_function.points[0].value - 1;
  expect(f, TC_ERROR_INVALID, "/transferFunction/points/1");
}

TEST_WITH(labels_are_checked_where_they_are_read, set_up, tear_down) {
  fixture *f = *state;
  strcpy(f->scene.labels.volume, "segments");
  f->scene.labels.opacity = 1.5;
  expect(f, TC_ERROR_INVALID, "/labels/opacity");
  f->scene.labels.opacity = 1;
  f->scene.labels.colors = g_new0(tc_label_color, 2);
  f->scene.labels.n_colors = 2; /* twice label 0 */
  expect(f, TC_ERROR_INVALID, "/labels/colors");
  f->scene.labels.n_colors = 1;
  f->scene.labels.colors[0].rgba[2] = NAN;
  expect(f, TC_ERROR_INVALID, "/labels/colors");
  f->scene.mode = TC_MODE_AVERAGE;
  assert_true(tc_explain(f->volume, &f->scene, 48, 48, &f->plan, NULL));
  assert_false(f->plan.key.labels);
}

TEST_WITH(what_is_not_built_is_refused, set_up, tear_down) {
  fixture *f = *state;
  f->scene.mode = TC_MODE_SPLAT;
  f->scene.filter = TC_FILTER_NEAREST;
  expect(f, TC_ERROR_UNSUPPORTED, "/filter");
  f->scene.filter = TC_FILTER_LINEAR;
  f->scene.splat.kernel_radius = 0;
  expect(f, TC_ERROR_INVALID, "/splat/kernelRadius");
  f->scene.splat.kernel_radius = 1;
  g_strlcpy(f->scene.splat.attribute, "density", sizeof f->scene.splat.attribute);
  expect(f, TC_ERROR_INVALID, "/splat/attribute");
  f->scene.splat.attribute[0] = 0;
  f->scene.mode = TC_MODE_DVR;
}

TEST_WITH(sizes_are_limited, set_up, tear_down) {
  fixture *f = *state;
  f->scene.image.width = 8193;
  expect(f, TC_ERROR_LIMIT, "/image/width");
  f->scene.image.width = 0;
  expect(f, TC_ERROR_INVALID, "/image/width");
}

static void render(fixture *f) {
  GError *error = NULL;
  if (!tc_render(f->renderer, f->volume, &f->scene, &(tc_render_request){.explanation = &f->plan}, &f->frame, &error)) fail_msg("%s", error->message);
}

/* A stage costs time only when it is built: stats say so per frame. */
TEST_WITH(a_change_rebuilds_what_depends_on_it, set_up, tear_down) {
  fixture *f = *state;
  render(f);
  assert_true(f->frame.stats.tables_ms > 0 && f->frame.stats.skip_ms > 0);
  assert_true(f->plan.stages[TC_STAGE_TABLE_2D].included && f->plan.stages[TC_STAGE_TABLE_2D].bytes > 0);
  f->scene.camera.position[0] += 40; /* the camera: nothing */
  render(f);
  assert_true(f->frame.stats.tables_ms == 0 && f->frame.stats.skip_ms == 0);
  f->scene.image.background[2] = 0.5; /* the background: nothing */
  f->scene.image.width = 61;
  render(f);
  assert_true(f->frame.stats.tables_ms == 0 && f->frame.stats.skip_ms == 0);
  f->scene.transfer_function.points[1].color[0] *= 0.5; /* a colour: one table; what is empty stays so */
  render(f);
  assert_true(f->frame.stats.tables_ms > 0 && f->frame.stats.skip_ms == 0);
  f->scene.sampling.step = 0.7; /* the step: the same */
  render(f);
  assert_true(f->frame.stats.tables_ms > 0 && f->frame.stats.skip_ms == 0);
  f->scene.sampling.step = 1;
  f->scene.transfer_function.points[1].color[0] *= 2; /* and back: the old table is still there */
  render(f);
  assert_true(f->frame.stats.tables_ms == 0 && f->frame.stats.skip_ms == 0);
}

TEST_WITH(every_stage_has_its_reason, set_up, tear_down) {
  fixture *f = *state;
  render(f);
  for (int i = 0; i < TC_STAGE_COUNT; i++) {
    assert_true(strlen(f->plan.stages[i].reason) > 5);
    if (!f->plan.stages[i].included) assert_int_equal(f->plan.stages[i].bytes, 0);
  }
  assert_true(f->plan.stages[TC_STAGE_TERMINATION].included && f->plan.key.termination);
  assert_false(f->plan.stages[TC_STAGE_GRADIENT].included && f->scene.shading.model == TC_SHADING_NONE);
  f->scene.sampling.termination = 0;
  f->scene.image.linear_light = true;
  render(f);
  assert_false(f->plan.stages[TC_STAGE_TERMINATION].included || f->plan.key.termination);
  assert_true(f->plan.stages[TC_STAGE_LINEAR_LIGHT].included);
  assert_non_null(strstr(f->plan.kernel, "dvr.preintegrated.linear"));
}

static tc_volume *noise(void) {
  const tc_volume_desc d = {.dims = {12, 12, 12}, .type = TC_U8, .spacing = {1, 1, 1}, .slope = 1,
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  tc_volume *v = tc_volume_new(&d, NULL);
  uint8_t *voxels = tc_volume_voxels(v);
  for (int i = 0; i < 12 * 12 * 12; i++) voxels[i] = (uint8_t)(i * 2654435761u >> 24);
  tc_volume_seal(v);
  return v;
}

/* What only a frame can find out (here: no block is empty) is said beside the plan, which stays what it was. */
TEST_WITH(a_frame_changes_no_plan, set_up, tear_down) {
  fixture *f = *state;
  tc_volume_unref(f->volume);
  f->volume = noise();
  f->scene.mode = TC_MODE_ISOSURFACE;
  f->scene.isosurface.value = 128;
  tc_plan before, after;
  tc_plan_make(f->volume, &f->scene, NULL, &before);
  render(f);
  tc_plan_make(f->volume, &f->scene, NULL, &after);
  assert_memory_equal(&before.key, &after.key, sizeof before.key);
  assert_true(before.key.skipping && before.resources == after.resources);
  assert_true(tc_plan_has(&before, TC_RESOURCE_DISTANCE_MAP) && !tc_plan_has(&before, TC_RESOURCE_BOXES));
  assert_false(f->plan.key.skipping || f->plan.stages[TC_STAGE_SKIPPING].included);
  assert_non_null(strstr(f->plan.stages[TC_STAGE_SKIPPING].reason, "only 0.0 %"));
}

/* A ball of radius 24 in 64 voxels, seen without perspective: 96 x 96 mm over the whole picture. */
static void ball_seen_whole(fixture *f, int size) {
  const tc_volume_desc d = {.dims = {64, 64, 64}, .type = TC_U8, .spacing = {1, 1, 1}, .slope = 1,
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  tc_volume *v = tc_volume_new(&d, NULL);
  uint8_t *voxels = tc_volume_voxels(v);
  for (int i = 0; i < 64 * 64 * 64; i++) {
    const double x = i % 64 - 31.5, y = i / 64 % 64 - 31.5, z = i / 4096 - 31.5;
    voxels[i] = x * x + y * y + z * z < 24 * 24 ? 200 : 0;
  }
  tc_volume_seal(v);
  tc_volume_unref(f->volume);
  f->volume = v;
  tc_scene_fit(&f->scene, v);
  f->scene.camera.projection = TC_ORTHOGRAPHIC;
  f->scene.camera.height_mm = 96;
  f->scene.image.width = f->scene.image.height = size;
  f->scene.mode = TC_MODE_SPLAT;
  f->scene.splat.threshold[0] = f->scene.isosurface.value = 100;
  f->scene.splat.threshold[1] = 255;
}

/* What costs are linear in is what the ball's geometry says; splats are named where a picture is large, rays where it
 * is small; and the plan says so. */
TEST_WITH(the_cheaper_mode_is_named, set_up, tear_down) {
  fixture *f = *state;
  tc_object_cost c;
  const double area = M_PI * 24 * 24;
  ball_seen_whole(f, 480);
  assert_true(tc_object_cost_of(f->volume, &f->scene, 480, 480, NULL, &c));
  printf("near %.1f of %.1f, hits %.1f of %.1f, seen %.2f of %.2f, surface %.2f kilovoxels\n", c.terms[TC_TERM_NEAR],
         c.terms[TC_TERM_STEPS], c.terms[TC_TERM_HITS], area * 25 / 1000,
         c.terms[TC_TERM_SEEN], area / 1000, c.terms[TC_TERM_SURFACE]);
  assert_true(fabs(c.terms[TC_TERM_HITS] / (area * 25 / 1000) - 1) < 0.05); /* 1.6 % a ray at the rim */
  assert_true(fabs(c.terms[TC_TERM_SEEN] / (area / 1000) - 1) < 0.05);
  assert_true(fabs(c.terms[TC_TERM_SURFACE] / c.terms[TC_TERM_SEEN] - 2) < 0.01); /* in and out again */
  assert_true(c.terms[TC_TERM_NEAR] > 0 && c.terms[TC_TERM_NEAR] < 0.5 * c.terms[TC_TERM_STEPS]);
  assert_true(fabs(c.terms[TC_TERM_APART] / c.terms[TC_TERM_NEAR] - 0.2) < 0.01); /* five rays a voxel */
  assert_true(c.ms[TC_OBJECT_SPLAT] < c.ms[TC_OBJECT_ISOSURFACE]);
  tc_explanation plan;
  assert_true(tc_explain(f->volume, &f->scene, 480, 480, &plan, NULL));
  assert_true(plan.has_object && plan.object.cheapest == c.cheapest);
  assert_non_null(strstr(plan.stages[TC_STAGE_SPLATS].reason, "cheapest: about"));
  assert_true(tc_object_cost_of(f->volume, &f->scene, 24, 24, NULL, &c));
  assert_true(c.ms[TC_OBJECT_ISOSURFACE] < c.ms[TC_OBJECT_SPLAT]);
  const atomic_bool over = true;
  assert_false(tc_object_cost_of(f->volume, &f->scene, 480, 480, &over, &c));
  assert_true(c.terms[TC_TERM_RAYS] == 0); /* it walked none */
  f->scene.splat.threshold[0] = 1e6;
  assert_false(tc_object_cost_of(f->volume, &f->scene, 24, 24, NULL, &c)); /* no object to be seen */
  f->scene.splat.threshold[0] = 100, f->scene.mode = TC_MODE_DVR;
  assert_false(tc_object_cost_of(f->volume, &f->scene, 480, 480, NULL, &c));
}

TESTS(NULL, NULL)
