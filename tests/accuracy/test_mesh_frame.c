/* Mode mesh against the surface itself (reference/): where it is seen, how far, how it is lit; and what must not matter. */
#include "tests/support/test.h"

#include <inttypes.h>
#include <pthread.h>

#include "renderer/base/clock.h"
#include "renderer/base/halt.h"
#include "renderer/frame/mesh_job.h"
#include "renderer/quality/meter.h"
#include "renderer/reference/reference.h"
#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/renderers.h"

enum { SIDE = 90, PIXELS = SIDE * SIDE };

static tc_volume *waves(tc_voxel_type type) {
  return test_volume(&(test_grid){.dims = {40, 36, 38}, .type = type, .slope = type == TC_F32 ? 1 : 0.004,
                                  .spacing = {1, 1.3, 0.8}}, test_waves, &(double){24});
}

static void mesh_scene(tc_scene *scene, const tc_volume *volume, tc_projection projection) {
  test_scene(scene, SIDE, SIDE);
  test_scene_frame(scene, volume, projection, (double[3]){1, -0.6, 0.4});
  scene->mode = TC_MODE_MESH;
  scene->isosurface.value = 0.55;
  scene->shading.model = TC_SHADING_BLINN_PHONG;
}

typedef struct truth {
  float depth[PIXELS]; /* INFINITY: nothing */
  float rgba[PIXELS][4];
} truth;

static void find_truth(tc_volume *volume, const tc_scene *scene, truth *t) {
  GError *error = NULL;
  g_autoptr(tc_reference) r = tc_reference_new(volume, scene, SIDE, SIDE, 0, &error);
  if (!r) fail_msg("%s", error->message);
  for (int i = 0; i < PIXELS; i++) {
    tc_reference_hit hit;
    double rgba[4];
    bool met = tc_reference_surface(r, i % SIDE + 0.5, i / SIDE + 0.5, &hit);
    t->depth[i] = met ? (float)hit.distance_mm : INFINITY;
    tc_reference_pixel(r, i % SIDE + 0.5, i / SIDE + 0.5, rgba);
    for (int c = 0; c < 4; c++) t->rgba[i][c] = (float)rgba[c];
  }
}

/* The surface there is smooth, as far as pixels around it tell: nothing ends within two of it. */
static bool is_smooth(const truth *t, int i) {
  int x = i % SIDE, y = i / SIDE;
  if (x < 2 || y < 2 || x > SIDE - 3 || y > SIDE - 3) return false;
  for (int v = -2; v <= 2; v++)
    for (int u = -2; u <= 2; u++) {
      float other = t->depth[i + v * SIDE + u];
      if (isfinite(other) != isfinite(t->depth[i]) || fabsf(other - t->depth[i]) > 2) return false;
    }
  return true;
}

TEST(surface_is_where_the_field_has_it) {
  static truth t;
  const int which = test_widest();
  for (int round = 0; round < 6; round++) {
    g_autoptr(tc_volume) volume = waves(round % 3 ? TC_U8 : TC_F32);
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, round & 1 ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    if (round > 3) scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -24, scene.clip.n_planes = 1;
    find_truth(volume, &scene, &t);
    const tc_render_request request = {.want_linear = true, .want_depth = true};
    tc_explanation plan;
    tc_frame *frame = test_draw(which, volume, &scene, &request, &plan);
    int smooth = 0, wrong = 0;
    double apart = 0, colour = 0;
    for (int i = 0; i < PIXELS; i++) {
      if (!is_smooth(&t, i)) continue;
      smooth++;
      wrong += isfinite(t.depth[i]) != (frame->linear[4 * i + 3] == 1) || isfinite(t.depth[i]) != isfinite(frame->depth[i]);
      if (!isfinite(t.depth[i]) || !isfinite(frame->depth[i])) continue;
      apart = fmax(apart, fabs(t.depth[i] - frame->depth[i]));
      for (int c = 0; c < 3; c++) colour += fabs(t.rgba[i][c] - frame->linear[4 * i + c]) / 3;
    }
    printf("  %d smooth pixels, %d wrong; at most %.3f mm apart; mean difference of colours %.4f\n", smooth, wrong, apart,
           colour / smooth);
    assert_true(smooth > PIXELS / 5 && wrong == 0 && apart < 0.1 && colour / smooth < 0.005);
    assert_true(plan.stages[TC_STAGE_MESH].included && plan.stages[TC_STAGE_MESH].bytes > 1000);
    assert_false(plan.stages[TC_STAGE_TABLE_2D].included || plan.stages[TC_STAGE_SKIPPING].included);
  }
}

TEST(every_renderer_draws_the_same_bytes) {
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  scene.sampling.rays_per_pixel = 4;
  const uint8_t *first = NULL;
  EACH_RENDERER(i) {
    const tc_frame *frame = test_draw(i, volume, &scene, NULL, NULL);
    if (!first) first = frame->rgba;
    assert_memory_equal(frame->rgba, first, 4 * PIXELS);
  }
}

/* The numbers of a plan's sentence "of N clusters N outside the view, N facing away"; hidden and shaded: 0 if not said. */
static void read_counts(const tc_explanation *plan, size_t n[3], uint64_t *hidden, uint64_t *shaded) {
  const char *reason = plan->stages[TC_STAGE_MESH].reason, *drawn = strstr(reason, "facing away; ");
  const char *at = strstr(reason, "; of ");
  *hidden = *shaded = 0;
  assert_non_null(at);
  assert_int_equal(sscanf(at, "; of %zu clusters %zu outside the view, %zu facing away", &n[0], &n[1], &n[2]), 3);
  if (drawn)
    assert_int_equal(sscanf(drawn, "facing away; %" SCNu64 " hidden (once a tile), %" SCNu64 " pixels shaded", hidden, shaded), 2);
}

TEST(the_plan_counts_what_is_left_out) {
  const int which = test_widest();
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  tc_explanation plan;
  size_t n[3], all;
  uint64_t hidden, shaded, covered = 0;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  const tc_frame *frame = test_draw(which, volume, &scene, NULL, &plan);
  read_counts(&plan, n, &hidden, &shaded);
  for (int i = 0; i < PIXELS; i++) covered += frame->linear[4 * i + 3] > 0;
  all = n[0];
  assert_true(all > 0 && n[1] + n[2] < all && shaded > 0);
  assert_true(shaded == covered); /* one sample: a pixel shows one triangle */
  assert_true(frame->stats.leaps == n[1] + n[2] + hidden && frame->stats.hidden == hidden);
  scene.camera.fov_y_deg /= 4; /* most of the volume beyond the picture's edges */
  test_draw(which, volume, &scene, NULL, &plan);
  read_counts(&plan, n, &hidden, &shaded);
  printf("  %zu of %zu clusters outside, %zu facing away; %zu shaded\n", n[1], n[0], n[2], (size_t)shaded);
  assert_true(n[0] == all && n[1] > all / 8 && n[1] + n[2] < all && shaded > 0);
}

static void look_away(tc_scene *scene) {
  for (int k = 0; k < 3; k++) scene->camera.target[k] = 2 * scene->camera.position[k] - scene->camera.target[k];
}

/* Draws; true if nothing was extracted, which the plan says, and the picture is empty. */
static bool extracts_nothing(tc_volume *volume, const tc_scene *scene, const tc_render_request *request) {
  tc_explanation plan;
  const tc_frame *frame = test_draw(test_widest(), volume, scene, request, &plan);
  const bool said = strstr(plan.stages[TC_STAGE_MESH].reason, "nothing is extracted") != NULL;
  if (said)
    for (int i = 0; i < PIXELS; i++) assert_true(frame->linear[4 * i + 3] == 0);
  assert_true(said == (strstr(plan.stages[TC_STAGE_MESH].reason, "facing away") == NULL));
  return said && plan.stages[TC_STAGE_MESH].bytes < 4096;
}

TEST(nothing_is_extracted_outside_the_view) {
  g_autoptr(tc_volume) volume = waves(TC_U8);
  for (int projection = 0; projection < 2; projection++) {
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, projection ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    scene.isosurface.value += 0.01 + 0.02 * projection;
    look_away(&scene);
    assert_true(extracts_nothing(volume, &scene, NULL));
    look_away(&scene);
    assert_false(extracts_nothing(volume, &scene, NULL)); /* seen again, it is extracted */
    scene.camera.target[0] += 500, scene.camera.position[0] += 500;
    assert_true(extracts_nothing(volume, &scene, NULL));
    scene.camera.target[0] -= 500, scene.camera.position[0] -= 500;
    scene.clip.planes[0][1] = 1, scene.clip.planes[0][3] = -1000, scene.clip.n_planes = 1;
    assert_true(extracts_nothing(volume, &scene, NULL));
  }
}

/* Nor is a mesh of one's own cut into clusters, wherever the volume is. */
TEST(no_mesh_is_clustered_outside_the_view) {
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_autoptr(tc_mesh) far = tc_mesh_extract(volume, 0.5, &(tc_mesh_options){.normals = true}, NULL);
  const tc_mesh_surface own = {.source = TC_SURFACE_OF_MESH, .opacity = 1, .visible = true}, value = {.value = 0.53, .opacity = 1, .visible = true};
  const tc_mesh_surface both[2] = {own, value};
  tc_mesh *const meshes[2] = {far, NULL};
  const tc_render_request request = {.want_linear = true, .meshes = meshes};
  far->origin[0] += 1e4; /* beside the volume */
  for (int projection = 0; projection < 2; projection++) {
    g_auto(tc_scene) scene;
    mesh_scene(&scene, volume, projection ? TC_ORTHOGRAPHIC : TC_PERSPECTIVE);
    tc_scene_set_surfaces(&scene, g_memdup2(&own, sizeof own), 1);
    assert_true(extracts_nothing(volume, &scene, &request)); /* the volume is in the view */
    scene.camera.target[0] += 1e4, scene.camera.position[0] += 1e4;
    assert_false(extracts_nothing(volume, &scene, &request));
    look_away(&scene);
    assert_true(extracts_nothing(volume, &scene, &request));
    look_away(&scene);
    scene.clip.planes[0][0] = -1, scene.clip.planes[0][3] = 5000, scene.clip.n_planes = 1;
    assert_true(extracts_nothing(volume, &scene, &request));
    scene.clip.n_planes = 0;
    tc_scene_set_surfaces(&scene, g_memdup2(both, sizeof both), 2);
    assert_false(extracts_nothing(volume, &scene, &request)); /* the mesh is in the view, the volume is not */
  }
}

/* Once extracted a surface stays; another value or another volume has its own; where it is nowhere the picture is empty. */
TEST(a_surface_is_extracted_once) {
  const int which = test_widest();
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  tc_explanation plan;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  test_draw(which, volume, &scene, NULL, &plan);
  assert_true(plan.stages[TC_STAGE_MESH].ms > 0);
  scene.camera.position[0] += 10, scene.isosurface.color[1] = 0.2, scene.shading.ambient = 0.4;
  test_draw(which, volume, &scene, NULL, &plan);
  assert_true(plan.stages[TC_STAGE_MESH].ms == 0);
  scene.isosurface.value = 0.5;
  test_draw(which, volume, &scene, NULL, &plan);
  assert_true(plan.stages[TC_STAGE_MESH].ms > 0);
  scene.isosurface.value = 5;
  const tc_frame *frame = test_draw(which, volume, &scene, NULL, &plan);
  for (int i = 0; i < PIXELS; i++) assert_true(frame->linear[4 * i + 3] == 0);
  assert_non_null(strstr(plan.stages[TC_STAGE_GRADIENT].reason, "empty picture"));
}

/* Balls of radius 8 mm about (12, 20, 20), label 3, and (28, 20, 20), label 7. */
static tc_volume *balls(void) {
  const tc_volume_desc d = {.type = TC_U8, .slope = 1, .frames = 1, .dims = {40, 40, 40}, .spacing = {1, 1, 1},
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  tc_volume *v = tc_volume_new(&d, NULL);
  uint8_t *to = tc_volume_voxels(v);
  for (int i = 0; i < 40 * 40 * 40; i++) {
    double x = i % 40, y = i / 40 % 40 - 20, z = i / 1600 - 20, r = 64 - y * y - z * z;
    to[i] = (x - 12) * (x - 12) <= r ? 3 : (x - 28) * (x - 28) <= r ? 7 : 0;
  }
  tc_volume_seal(v);
  return v;
}

static const float *pixel_of(const tc_frame *frame, double x) { /* of the point (x, 20, 20) */
  return frame->linear + 4 * (SIDE / 2 * SIDE + (int)((x - 20) * SIDE / 50 + SIDE / 2.0));
}

TEST(labels_have_surfaces_of_their_colours) {
  const int which = test_widest();
  g_autoptr(tc_volume) labels = balls();
  g_auto(tc_scene) scene;
  tc_explanation plan;
  mesh_scene(&scene, labels, TC_PERSPECTIVE);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){20, -50, 20}, (double[3]){20, 20, 20}, 50);
  scene.shading.model = TC_SHADING_NONE;
  scene.isosurface.value = 1e9; /* has no meaning then */
  strcpy(scene.labels.volume, "balls");
  scene.labels.opacity = 0.25;
  const tc_render_request request = {.want_linear = true, .want_depth = true, .labels = labels};
  size_t n;
  const double(*palette)[3] = tc_label_palette(&n);
  const tc_frame *frame = test_draw(which, labels, &scene, &request, &plan);
  int covered = 0;
  for (int c = 0; c < 3; c++) {
    assert_true(fabs(pixel_of(frame, 12)[c] - palette[2][c]) < 0.01);
    assert_true(fabs(pixel_of(frame, 28)[c] - palette[6][c]) < 0.01);
  }
  for (int i = 0; i < PIXELS; i++) covered += frame->linear[4 * i + 3] == 1;
  assert_true(fabs(covered * 50.0 * 50 / PIXELS - 2 * M_PI * 64) < 0.08 * 2 * M_PI * 64);
  assert_true(fabs(frame->depth[SIDE / 2 * SIDE + (int)(pixel_of(frame, 12) - frame->linear) / 4 % SIDE] - 62) < 1);
  assert_true(plan.stages[TC_STAGE_MESH].included && plan.stages[TC_STAGE_LABELS].included);
  const tc_label_color red = {7, {1, 0, 0, 1}};
  tc_scene_set_colors(&scene, g_memdup2(&red, sizeof red), 1);
  frame = test_draw(which, labels, &scene, &request, &plan);
  assert_true(plan.stages[TC_STAGE_MESH].ms == 0); /* colours alone: nothing is extracted */
  assert_true(pixel_of(frame, 28)[0] > 0.99 && pixel_of(frame, 28)[1] < 0.01);
  const uint32_t seven = 7;
  tc_scene_set_visible(&scene, g_memdup2(&seven, sizeof seven), 1);
  frame = test_draw(which, labels, &scene, &request, NULL);
  assert_true(pixel_of(frame, 12)[3] == 0 && pixel_of(frame, 28)[3] == 1);
}

TEST(frames_stop_and_go_on_to_the_same_picture) {
  const int which = test_widest();
  tc_scene scene;
  g_auto(tc_frame) frame = {0};
  for (int cancel = 0; cancel < 2; cancel++) {
    g_autoptr(tc_volume) volume = waves(TC_F32); /* new: extracted while it is stopped */
    mesh_scene(&scene, volume, TC_PERSPECTIVE);
    scene.image.width = scene.image.height = 200;
    tc_interrupt interrupt;
    tc_interrupt_init(&interrupt);
    tc_render_request request = {.interrupt = &interrupt, .resume = true};
    GError *error = NULL;
    int stops = 0;
    if (cancel)
      atomic_store(&interrupt.cancel, true);
    else
      atomic_store(&interrupt.pause_us, 1); /* long past */
    while (!tc_render(test_renderers[which], volume, &scene, &request, &frame, &error) && stops < 2000) {
      assert_true(g_error_matches(error, TC_ERROR, cancel ? TC_ERROR_CANCELLED : TC_ERROR_PAUSED));
      g_clear_error(&error);
      if (++stops == 3 && cancel) atomic_store(&interrupt.cancel, false);
    }
    assert_true(stops >= (cancel ? 3 : 1) && stops < 2000); /* a pause: after building, however many threads there are */
    const tc_frame *whole = test_draw(which, volume, &scene, NULL, NULL);
    assert_memory_equal(frame.rgba, whole->rgba, 4 * 200 * 200);
    tc_scene_clear(&scene);
  }
}

/* The scene's list: values, labels and their colours together, each made once, whatever is done to the others. */
TEST(several_surfaces_are_one_picture) {
  const int which = test_widest();
  g_autoptr(tc_volume) labels = balls(); /* 0, 3 and 7: at 1.5 the surface of both, at 5 that of the second alone */
  g_auto(tc_scene) scene;
  tc_explanation plan;
  mesh_scene(&scene, labels, TC_PERSPECTIVE);
  test_scene_look(&scene, TC_ORTHOGRAPHIC, (double[3]){20, -50, 20}, (double[3]){20, 20, 20}, 50);
  scene.shading.model = TC_SHADING_NONE;
  strcpy(scene.labels.volume, "balls");
  const tc_mesh_surface list[4] = {
      {.source = TC_SURFACE_OF_VALUE, .value = 1.5, .color = {1, 0, 0}, .opacity = 0.25, .has_color = true, .visible = true},
      {.source = TC_SURFACE_OF_VALUE, .value = 5, .color = {0, 1, 0}, .opacity = 1, .has_color = true, .visible = true},
      {.source = TC_SURFACE_OF_LABEL, .label = 3, .opacity = 1, .visible = true},
      {.source = TC_SURFACE_OF_LABEL, .label = 7, .opacity = 1, .visible = false}};
  const tc_render_request request = {.want_linear = true, .labels = labels};
  size_t n;
  const double(*palette)[3] = tc_label_palette(&n);
  tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 4);
  const tc_frame *frame = test_draw(which, labels, &scene, &request, &plan);
  for (int c = 0; c < 3; c++) {
    assert_true(fabs(pixel_of(frame, 12)[c] - (0.25 * (c == 0) + 0.75 * palette[2][c])) < 0.01);
    assert_true(fabs(pixel_of(frame, 28)[c] - (0.25 * (c == 0) + 0.75 * (c == 1))) < 0.01);
  }
  assert_true(pixel_of(frame, 1)[3] == 0 && plan.stages[TC_STAGE_MESH].included);
  assert_non_null(strstr(plan.stages[TC_STAGE_MESH].reason, "3 of 4 surfaces"));
  const double all_ms = plan.stages[TC_STAGE_MESH].ms;
  assert_true(all_ms > 0);
  scene.mesh.surfaces[0].opacity = 0.5, scene.mesh.surfaces[1].color[2] = 1;
  frame = test_draw(which, labels, &scene, &request, &plan); /* colours and opacities: nothing is made */
  assert_true(plan.stages[TC_STAGE_MESH].ms == 0 && fabs(pixel_of(frame, 28)[2] - 0.5) < 0.01);
  scene.shading.model = TC_SHADING_LAMBERT, scene.mesh.surfaces[1].own_shading = 3; /* model none; ambient is its own too */
  frame = test_draw(which, labels, &scene, &request, NULL);
  assert_true(fabs(pixel_of(frame, 28)[2] - 0.5) < 0.01 && pixel_of(frame, 12)[2] < 0.6 * palette[2][2]);
  scene.mesh.surfaces[1].model = TC_SHADING_LAMBERT; /* facing the eye: ambient 0 and diffuse 0.7 */
  frame = test_draw(which, labels, &scene, &request, NULL);
  assert_true(fabs(pixel_of(frame, 28)[2] - 0.5 * scene.shading.diffuse) < 0.02);
  scene.mesh.lights[0] = (tc_mesh_light){.direction = {0, -1, 0}, .color = {0, 0, 1}, .intensity = 0.5}, scene.mesh.n_lights = 1;
  frame = test_draw(which, labels, &scene, &request, NULL);
  assert_true(fabs(pixel_of(frame, 28)[2] - 0.25 * scene.shading.diffuse) < 0.02 && pixel_of(frame, 28)[1] < 0.01);
  scene.shading.model = scene.mesh.surfaces[1].model = TC_SHADING_NONE, scene.mesh.n_lights = 0;
  scene.mesh.surfaces[1].visible = false, scene.mesh.surfaces[0].two_sided = true;
  frame = test_draw(which, labels, &scene, &request, &plan);
  assert_true(plan.stages[TC_STAGE_MESH].ms > 0 && fabs(pixel_of(frame, 28)[3] - 0.75) < 0.01); /* front and back of one */
  scene.mesh.surfaces[1].visible = true;
  scene.mesh.surfaces[0].value = 9; /* nowhere */
  frame = test_draw(which, labels, &scene, &request, &plan);
  assert_true(pixel_of(frame, 28)[1] == 1 && pixel_of(frame, 28)[0] == 0 && pixel_of(frame, 12)[3] == 1);
  for (size_t i = 0; i < 4; i++) scene.mesh.surfaces[i].visible = false;
  frame = test_draw(which, labels, &scene, &request, &plan);
  for (int i = 0; i < PIXELS; i++) assert_true(frame->linear[4 * i + 3] == 0);
}

static double error_of_drawn(tc_volume *volume, tc_volume *labels, tc_mesh *const *meshes, const tc_scene *drawn, const tc_scene *truth) {
  const tc_render_request request = {.want_linear = true, .labels = labels, .meshes = meshes};
  tc_meter_result result;
  GError *error = NULL;
  tc_meter *meter = tc_meter_new(test_draw(test_widest(), volume, drawn, &request, NULL), 600, 1);
  if (!tc_meter_measure(meter, &(tc_meter_subject){volume, labels, meshes, truth, NULL}, 0, &result, &error))
    fail_msg("%s", error->message);
  tc_meter_free(meter);
  return result.rms;
}

static double error_of(tc_volume *volume, const tc_scene *drawn, const tc_scene *truth) {
  return error_of_drawn(volume, NULL, NULL, drawn, truth);
}

/* Labels 1 and 2, a ball's halves. */
static double in_two_halves(double x, double y, double z, const void *user) {
  return pow(x - 20, 2) + pow(y - 20, 2) + pow(z - 20, 2) < 150 ? 1 + (x > 20) : 0;
}

/* Lists of surfaces have the exact surfaces as their truth: all of their layers, of each its own colour and shading. */
TEST(lists_are_near_the_exact_surfaces) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_radius2, (double[3]){20, 20, 20});
  const tc_mesh_surface list[3] = {
      {.value = 200, .color = {1, 0.4, 0.2}, .opacity = 0.4, .has_color = true, .visible = true, .two_sided = true},
      {.value = 100, .color = {0.3, 1, 0.2}, .opacity = 0.5, .has_color = true, .visible = true, .own_shading = 1},
      {.value = 36, .color = {0.3, 0.4, 1}, .opacity = 1, .has_color = true, .visible = true, .two_sided = true, .own_shading = 4, .diffuse = 0.9}};
  g_auto(tc_scene) scene, other;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  scene.shading.model = TC_SHADING_LAMBERT, scene.shading.gradient = TC_GRADIENT_CENTRAL;
  tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 3);
  const double off = error_of(volume, &scene, &scene);
  tc_scene_copy(&other, &scene);
  print_message("  rms %.1e", off);
  assert_true(off < 0.012);
  for (int i = 0; i < 3; i++) { /* each surface counts */
    tc_scene_set_surfaces(&other, g_memdup2(list, sizeof list), 3);
    if (i == 2) other.mesh.surfaces[1].two_sided = true; else other.mesh.surfaces[2 * i].value *= 1.1;
    print_message(", %.4f", error_of(volume, &other, &scene));
    assert_true(error_of(volume, &other, &scene) > 2 * off);
  }
  print_message("\n");
}

/* Whatever a list holds, alone and within a volume: each member counts, the lights too. */
TEST(whatever_is_drawn_has_a_truth) {
  const test_grid grid = {.dims = {40, 40, 40}, .type = TC_U8, .slope = 1};
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_radius2, (double[3]){20, 20, 20});
  g_autoptr(tc_volume) labels = test_volume(&grid, in_two_halves, NULL);
  g_autoptr(tc_mesh) ball = tc_mesh_extract(volume, 300, &(tc_mesh_options){.normals = false}, NULL);
  const tc_mesh_surface list[4] = {
      {.source = TC_SURFACE_OF_MESH, .color = {1, 0.4, 0.2}, .opacity = 0.4, .has_color = true, .visible = true, .two_sided = true},
      {.source = TC_SURFACE_OF_LABEL, .label = 2, .opacity = 0.5, .visible = true, .two_sided = true},
      {.source = TC_SURFACE_OF_PLANE, .plane = TC_CORONAL, .opacity = 0.6, .visible = true, .two_sided = true},
      {.source = TC_SURFACE_OF_VALUE, .value = 36, .color = {0.3, 0.4, 1}, .opacity = 1, .has_color = true, .visible = true}};
  tc_mesh *const meshes[4] = {ball};
  static const tc_mode modes[3] = {TC_MODE_MESH, TC_MODE_DVR, TC_MODE_MIP};
  for (int m = 0; m < 3; m++) {
    g_auto(tc_scene) scene;
    const tc_knot fog[2] = {{-1000, {0.2, 0.4, 0.6}, 0.03}, {1000, {0.2, 0.4, 0.6}, 0.03}};
    mesh_scene(&scene, volume, TC_PERSPECTIVE);
    test_scene_knots(&scene, TC_KNOT_EXTINCTION, fog, 2);
    scene.mode = modes[m], scene.mesh.with_volume = true, scene.sampling.step = 0.25;
    scene.window.center = 200, scene.window.width = 1000, scene.labels.opacity = 1;
    g_strlcpy(scene.labels.volume, "labels", sizeof scene.labels.volume);
    scene.shading.model = TC_SHADING_LAMBERT, scene.shading.gradient = TC_GRADIENT_CENTRAL;
    scene.mesh.lights[0] = (tc_mesh_light){.direction = {0.3, -1, 0.2}, .color = {1, 0.8, 0.6}, .intensity = 0.7};
    scene.mesh.lights[1] = (tc_mesh_light){.at_camera = true, .color = {0.2, 0.4, 1}, .intensity = 0.5}, scene.mesh.n_lights = 2;
    tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 4);
    if (modes[m] == TC_MODE_MIP) scene.mesh.surfaces[1].source = TC_SURFACE_OF_VALUE, scene.mesh.surfaces[1].value = 150; /* no labels there */
    double off[6];
    for (int i = 0; i < 6; i++) { /* what is drawn, against a truth that lacks one thing from i = 1 on */
      g_auto(tc_scene) truth;
      tc_scene_copy(&truth, &scene);
      tc_scene_set_surfaces(&truth, g_memdup2(scene.mesh.surfaces, sizeof list), 4);
      if (i && i < 5) truth.mesh.surfaces[i - 1].visible = false;
      if (i == 5) truth.mesh.n_lights = 0;
      off[i] = error_of_drawn(volume, labels, meshes, &scene, &truth);
    }
    print_message("  %s: rms %.1e; without each %.3f %.3f %.3f %.3f, lights %.3f\n", tc_mode_names[modes[m]], off[0], off[1], off[2], off[3], off[4], off[5]);
    assert_true(off[0] < 0.012);
    for (int i = 1; i < 6; i++) assert_true(off[i] > 2 * off[0]);
  }
}

/* Without a list a mesh is every label. */
TEST(labels_have_a_truth) {
  const test_grid grid = {.dims = {40, 40, 40}, .type = TC_U8, .slope = 1};
  g_autoptr(tc_volume) labels = test_volume(&grid, in_two_halves, NULL);
  g_auto(tc_scene) scene, truth;
  mesh_scene(&scene, labels, TC_PERSPECTIVE);
  scene.shading.model = TC_SHADING_LAMBERT, scene.labels.opacity = 1;
  g_strlcpy(scene.labels.volume, "labels", sizeof scene.labels.volume);
  const double off = error_of_drawn(labels, labels, NULL, &scene, &scene);
  tc_scene_copy(&truth, &scene);
  tc_scene_set_visible(&truth, g_memdup2((const uint32_t[1]){1}, sizeof(uint32_t)), 1);
  const double without = error_of_drawn(labels, labels, NULL, &scene, &truth);
  print_message("  rms %.1e, without one %.3f\n", off, without);
  assert_true(off < 0.012 && without > 4 * off);
}

/* A mesh's own colours, in both compositing spaces; the truth without them is another picture. */
TEST(colours_of_vertices_are_the_truths) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_radius2, (double[3]){20, 20, 20});
  g_autoptr(tc_mesh) ball = tc_mesh_extract(volume, 200, &(tc_mesh_options){.normals = true}, NULL);
  const tc_mesh_surface list[2] = {{.source = TC_SURFACE_OF_MESH, .opacity = 0.6, .visible = true, .two_sided = true},
                                   {.value = 64, .color = {0.3, 0.4, 1}, .opacity = 1, .has_color = true, .visible = true}};
  tc_mesh *const meshes[2] = {ball};
  assert_true(tc_mesh_add_colors(ball, NULL));
  for (size_t v = 0; v < ball->n_vertices; v++) {
    const float *at = ball->positions[v];
    ball->colors[v] = (at[0] > 0 ? 0xff : 0x20) | (uint32_t)(127 + 8 * at[1]) << 8 | (at[2] > 2 ? 0xff0000 : 0);
  }
  for (int linear = 0; linear < 2; linear++) {
    g_auto(tc_scene) scene;
    g_auto(tc_scene) other;
    mesh_scene(&scene, volume, TC_PERSPECTIVE);
    scene.shading.model = TC_SHADING_LAMBERT, scene.shading.gradient = TC_GRADIENT_CENTRAL, scene.image.linear_light = linear;
    tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 2);
    tc_scene_copy(&other, &scene);
    tc_scene_set_surfaces(&other, g_memdup2(list, sizeof list), 2);
    other.mesh.surfaces[0].has_color = true, other.mesh.surfaces[0].color[0] = 1;
    const double off = error_of_drawn(volume, NULL, meshes, &scene, &scene), own = error_of_drawn(volume, NULL, meshes, &other, &other);
    const double without = error_of_drawn(volume, NULL, meshes, &scene, &other);
    print_message("  rms %.1e, of one colour %.1e; against that %.3f\n", off, own, without);
    assert_true(off < 0.012 && own < 0.012 && without > 0.05);
  }
}

/* The truth copies each mesh: one that is listed again and again is refused before. */
TEST(meshes_of_a_truth_are_bounded) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {4, 4, 4}, .type = TC_F32}, test_radius2, (double[3]){2, 2, 2});
  g_autoptr(tc_mesh) large = tc_mesh_new(2000000, 4000000, true, NULL);
  const tc_mesh_surface one = {.source = TC_SURFACE_OF_MESH, .opacity = 1, .visible = true};
  const tc_mesh_surface list[3] = {one, one, one};
  tc_mesh *const meshes[3] = {large, large, large};
  g_auto(tc_scene) scene;
  g_autoptr(GError) error = NULL;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  tc_scene_set_surfaces(&scene, g_memdup2(list, sizeof list), 3);
  assert_null(tc_meter_reference(&(tc_meter_subject){volume, NULL, meshes, &scene, NULL}, 8, 8, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT));
  print_message("%s\n", error->message);
}

typedef struct canceller {
  atomic_bool cancel;
  double after_ms, at_ms;
} canceller;

static void *cancel_later(void *data) {
  canceller *c = data;
  g_usleep((gulong)(c->after_ms * 1000));
  c->at_ms = tc_now_ms();
  atomic_store(&c->cancel, true);
  return NULL;
}

/* The truth of a large mesh without normals is soon given up, in every phase of its making. */
TEST(making_a_truth_is_cancelled) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {4, 4, 4}, .type = TC_F32}, test_radius2, (double[3]){2, 2, 2});
  g_autoptr(tc_mesh) large = tc_mesh_new(3000000, 2000000, false, NULL);
  const tc_mesh_surface one = {.source = TC_SURFACE_OF_MESH, .opacity = 1, .visible = true};
  tc_mesh *const meshes[1] = {large};
  g_auto(tc_scene) scene;
  uint64_t seed = 4;
  for (size_t v = 0; v < large->n_vertices; v++)
    for (int k = 0; k < 3; k++) large->positions[v][k] = (float)test_random(&seed);
  for (size_t i = 0; i < 3 * large->n_triangles; i++) large->triangles[i / 3][i % 3] = (uint32_t)((i / 2 + i % 2) % large->n_vertices);
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  tc_scene_set_surfaces(&scene, g_memdup2(&one, sizeof one), 1);
  const double begun = tc_now_ms();
  tc_reference_free(tc_meter_reference(&(tc_meter_subject){volume, NULL, meshes, &scene, NULL}, 8, 8, NULL));
  const double whole = tc_now_ms() - begun;
  double most = 0;
  for (int i = 0; i < 12; i++) {
    canceller c = {.after_ms = whole * i / 16};
    g_autoptr(GError) error = NULL;
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, cancel_later, &c), 0);
    tc_reference *truth = tc_meter_reference(&(tc_meter_subject){volume, NULL, meshes, &scene, &c.cancel}, 8, 8, &error);
    const double end = tc_now_ms();
    pthread_join(thread, NULL);
    if (!truth) most = fmax(most, end - c.at_ms);
    assert_true(truth ? i > 6 : g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED)); /* if this machine was faster than before */
    tc_reference_free(truth);
  }
  print_message("  made in %.0f ms, given up within %.0f\n", whole, most);
  assert_true(most < whole / 2);
}

/* ---- within a volume ---- */

/* The scene of balls(), seen along y from y = -50; its volume fills y from 0 to 39. */
static void scene_within(tc_scene *scene, const tc_volume *volume, tc_mode mode, double opacity) {
  mesh_scene(scene, volume, TC_ORTHOGRAPHIC);
  test_scene_look(scene, TC_ORTHOGRAPHIC, (double[3]){20, -50, 20}, (double[3]){20, 20, 20}, 50);
  scene->mode = mode;
  scene->shading.model = TC_SHADING_NONE;
  scene->window.center = 20, scene->window.width = 40;
  const tc_knot fog[2] = {{-1000, {0.2, 0.4, 0.6}, 0.03}, {1000, {0.2, 0.4, 0.6}, 0.03}};
  test_scene_knots(scene, TC_KNOT_EXTINCTION, fog, 2);
  const tc_mesh_surface ball = {.source = TC_SURFACE_OF_VALUE, .value = 64, .color = {1, 0.5, 0}, .opacity = opacity,
                                .has_color = true, .visible = true, .two_sided = true};
  tc_scene_set_surfaces(scene, g_memdup2(&ball, sizeof ball), 1);
  scene->mesh.with_volume = true;
}

typedef struct mixing {
  double clear, sum[4];
} mixing;

/* Fog of extinction 0.03 between two distances from the eye, mm. */
static void mix_volume(mixing *m, double from, double until) {
  static const double fog[3] = {0.2, 0.4, 0.6};
  from = fmax(from, 50), until = fmin(until, 89);
  const double share = m->clear * -expm1(-0.03 * (until - from));
  for (int c = 0; c < 3; c++) m->sum[c] += share * fog[c];
  m->sum[3] += share, m->clear -= share;
}

static void mix_surface(mixing *m, double opacity) {
  static const double color[3] = {1, 0.5, 0};
  for (int c = 0; c < 3; c++) m->sum[c] += m->clear * opacity * color[c];
  m->sum[3] += m->clear * opacity, m->clear *= 1 - opacity;
}

/* Squared distances from (20, 20, 20): fog is as thick everywhere, and at 64 there is a ball. */
static tc_volume *around_a_ball(void) {
  return test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_radius2, (double[3]){20, 20, 20});
}

TEST(surfaces_are_between_what_is_before_and_behind_them) {
  const int which = test_widest();
  g_autoptr(tc_volume) volume = around_a_ball();
  for (int round = 0; round < 4; round++) {
    const double opacity = round & 1 ? 1 : 0.4;
    g_auto(tc_scene) scene;
    tc_explanation plan;
    scene_within(&scene, volume, TC_MODE_DVR, opacity);
    scene.sampling.rays_per_pixel = round > 1 ? 3 : 1;
    scene.sampling.termination = 0;
    const tc_frame *frame = test_draw(which, volume, &scene, NULL, &plan);
    int met = 0;
    for (int i = 0; i < PIXELS; i++) {
      const double x = (i % SIDE + 0.5) * 50 / SIDE - 25, z = (i / SIDE + 0.5) * 50 / SIDE - 25, r2 = x * x + z * z;
      if ((r2 > 49 && r2 < 81) || fabs(x) > 18 || fabs(z) > 18) continue; /* outlines */
      mixing m = {.clear = 1};
      if (r2 < 49) {
        const double deep = sqrt(64 - r2); /* values are lower inside: the surface faces inwards, and is seen from behind */
        mix_volume(&m, 0, 70 - deep), mix_surface(&m, opacity);
        mix_volume(&m, 70 - deep, 70 + deep), mix_surface(&m, opacity);
        mix_volume(&m, 70 + deep, 1000);
        met++;
      } else {
        mix_volume(&m, 0, 1000);
      }
      for (int c = 0; c < 4; c++) assert_true(fabs(m.sum[c] - frame->linear[4 * i + c]) < 0.004);
    }
    assert_true(met > 400 && plan.stages[TC_STAGE_MESH].included && plan.stages[TC_STAGE_TABLE_2D].included);
  }
}

TEST(layers_are_bounded) {
  const unsigned most = tc_mesh_most_layers;
  g_autoptr(tc_volume) volume = around_a_ball();
  g_auto(tc_scene) scene;
  g_auto(tc_frame) frame = {0};
  GError *error = NULL;
  scene_within(&scene, volume, TC_MODE_DVR, 0.4);
  tc_mesh_most_layers = 500;
  assert_false(tc_render(test_renderers[test_widest()], volume, &scene, NULL, &frame, &error));
  tc_mesh_most_layers = most;
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT) && strstr(error->message, "more than 500 layers"));
  assert_string_equal(tc_error_pointer(error), "/mesh/surfaces");
  g_clear_error(&error);
  assert_true(tc_render(test_renderers[test_widest()], volume, &scene, NULL, &frame, NULL));
}

/* Brightness y / 40 grows along the rays: what is in front of a surface is darker than what is behind it. */
TEST(surfaces_end_and_divide_maxima) {
  const int which = test_widest();
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_linear, (double[4]){0, 1, 0, 0});
  for (int round = 0; round < 3; round++) {
    const double opacity = round ? 1 : 0.4;
    g_auto(tc_scene) scene;
    scene_within(&scene, volume, TC_MODE_MIP, opacity);
    scene.mesh.surfaces[0].value = 15; /* the plane y = 15 */
    if (round == 2) scene.clip.planes[0][0] = 1, scene.clip.planes[0][3] = -20, scene.clip.n_planes = 1;
    const tc_frame *frame = test_draw(which, volume, &scene, NULL, NULL);
    for (int i = 0; i < PIXELS; i++) {
      static const double color[3] = {1, 0.5, 0};
      const double x = (i % SIDE + 0.5) * 50 / SIDE - 25, z = (i / SIDE + 0.5) * 50 / SIDE - 25;
      if (fabs(x) > 18 || fabs(z) > 18 || (round == 2 && x < 1)) continue;
      for (int c = 0; c < 3; c++) {
        const double before = 15 / 40.0, behind = (1 - opacity) * (39 - 15) / 40.0;
        assert_true(fabs(before + (1 - before) * opacity * color[c] + behind - frame->linear[4 * i + c]) < 0.004);
      }
      assert_true(fabs(frame->linear[4 * i + 3] - 1) < 1e-5);
    }
    scene.mesh.surfaces[0].visible = false; /* parts of one: the maximum itself */
    frame = test_draw(which, volume, &scene, NULL, NULL);
    assert_true(fabs(frame->linear[4 * (SIDE / 2 * SIDE + SIDE / 2 + 5)] - 39 / 40.0) < 0.001);
  }
}

/* Three slices through (10, 12, 14), seen in perspective: each shows the field where it is met, in front of the others. */
TEST(slices_show_the_field_where_they_are) {
  static const double at[3] = {10, 12, 14}, ramp[4] = {0.01, 0.005, 0.008, 0};
  const int which = test_widest();
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_linear, ramp);
  g_auto(tc_scene) scene;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  scene.window.center = 0.4, scene.window.width = 1;
  scene.mpr.has_center = true;
  memcpy(scene.mpr.center, at, sizeof at);
  tc_mesh_surface planes[3] = {{.plane = TC_SAGITTAL}, {.plane = TC_CORONAL}, {.plane = TC_AXIAL}};
  for (int i = 0; i < 3; i++) planes[i].source = TC_SURFACE_OF_PLANE, planes[i].opacity = planes[i].visible = planes[i].two_sided = 1;
  tc_scene_set_surfaces(&scene, g_memdup2(planes, sizeof planes), 3);
  const tc_render_request request = {.want_linear = true, .want_depth = true};
  const tc_frame *frame = test_draw(which, volume, &scene, &request, NULL);
  const tc_camera *c = &scene.camera;
  double forward[3], right[3], down[3], length = 0, across = 0;
  for (int k = 0; k < 3; k++) forward[k] = c->target[k] - c->position[k], length += forward[k] * forward[k];
  for (int k = 0; k < 3; k++) forward[k] /= sqrt(length);
  for (int k = 0; k < 3; k++) right[k] = forward[(k + 1) % 3] * c->up[(k + 2) % 3] - forward[(k + 2) % 3] * c->up[(k + 1) % 3];
  for (int k = 0; k < 3; k++) across += right[k] * right[k];
  for (int k = 0; k < 3; k++) right[k] /= sqrt(across);
  for (int k = 0; k < 3; k++) down[k] = forward[(k + 1) % 3] * right[(k + 2) % 3] - forward[(k + 2) % 3] * right[(k + 1) % 3];
  int compared = 0;
  for (int i = 0; i < PIXELS; i++) {
    const double scale = tan(c->fov_y_deg * M_PI / 360) * 2 / SIDE, x = (i % SIDE + 0.5 - SIDE / 2.0) * scale,
                 y = (i / SIDE + 0.5 - SIDE / 2.0) * scale, norm = sqrt(1 + x * x + y * y);
    double ray[3], nearest = INFINITY, value = 0;
    bool certain = true;
    for (int k = 0; k < 3; k++) ray[k] = (forward[k] + x * right[k] + y * down[k]) / norm;
    for (int plane = 0; plane < 3; plane++) {
      const double t = (at[plane] - c->position[plane]) / ray[plane];
      double inside = INFINITY, here = 0;
      for (int k = 0; k < 3; k++) {
        const double p = c->position[k] + t * ray[k];
        if (k != plane) inside = fmin(inside, fmin(p, 39 - p));
        here += ramp[k] * p;
      }
      if (fabs(inside) < 0.1 || fabs(t - nearest) < 0.1) certain = false;
      if (inside > 0 && t < nearest) nearest = t, value = here;
    }
    if (!certain) continue;
    compared++;
    assert_true(isfinite(nearest) == (frame->linear[4 * i + 3] == 1));
    if (!isfinite(nearest)) continue;
    assert_true(fabs(frame->depth[i] - nearest) < 0.02);
    assert_true(fabs((double)frame->linear[4 * i] - fmin(fmax(value - 0.4 + 0.5, 0), 1)) < 0.002);
  }
  assert_true(compared > PIXELS * 3 / 4);
}

TEST(what_cannot_be_is_refused) {
  const tc_renderer_options small = {.threads = 1, .backend = TC_BACKEND_CPU, .cache_bytes = 100000};
  g_autoptr(tc_renderer) renderer = tc_renderer_new(&small, NULL);
  g_autoptr(tc_volume) volume = waves(TC_U8);
  g_auto(tc_scene) scene;
  g_auto(tc_frame) frame = {0};
  GError *error = NULL;
  mesh_scene(&scene, volume, TC_PERSPECTIVE);
  assert_false(tc_render(renderer, volume, &scene, NULL, &frame, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT));
  g_clear_error(&error);
  scene.isosurface.value = NAN;
  assert_false(tc_render(renderer, volume, &scene, NULL, &frame, &error));
  assert_string_equal(tc_error_pointer(error), "/isosurface/value");
  g_clear_error(&error);
  tc_mesh_surface one = {.source = TC_SURFACE_OF_LABEL, .label = 3, .opacity = 1, .visible = true};
  tc_scene_set_surfaces(&scene, g_memdup2(&one, sizeof one), 1);
  assert_false(tc_render(renderer, volume, &scene, NULL, &frame, &error));
  assert_string_equal(tc_error_pointer(error), "/mesh/surfaces/0"); /* no volume of labels */
  g_clear_error(&error);
}

TESTS(test_renderers_open, test_renderers_close)
