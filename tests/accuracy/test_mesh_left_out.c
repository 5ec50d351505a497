/* What a frame of mode mesh leaves out, as its plan counts it: what is outside the view, faces away, is hidden or was made before. */
#include "tests/support/mesh.h"

#include <inttypes.h>

#include "renderer/mesh/measure.h"

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

/* A frame looks at the vertices of a mesh outside the view once at most; of a mesh with a box, only where the box is not outside:
 * at all of them where a corner of the box alone is in the view, at few where the mesh is. */
TEST(no_mesh_outside_the_view_is_looked_at) {
  g_autoptr(tc_volume) volume = test_volume(&(test_grid){.dims = {40, 40, 40}, .type = TC_F32}, test_radius2, (double[3]){20, 20, 20});
  g_autoptr(tc_mesh) ball = tc_mesh_extract(volume, 324, &(tc_mesh_options){.normals = true}, NULL);
  const tc_mesh_surface own = {.source = TC_SURFACE_OF_MESH, .opacity = 1, .visible = true};
  tc_mesh *const meshes[1] = {ball};
  tc_mesh_measures measures;
  uint64_t looked_at[2][3];
  for (int boxed = 0; boxed < 2; boxed++) {
    if (boxed) tc_mesh_measure(ball, &measures);
    for (int view = 0; view < 3; view++) { /* away, past the ball but not past its box, at it */
      static const double clip[3] = {-1000, -25, 0}; /* mm behind the middle; the ball's radius is 18, its box's corners are 31 away */
      const tc_render_request request = {.want_linear = true, .meshes = meshes};
      g_auto(tc_scene) scene;
      mesh_scene(&scene, volume, TC_PERSPECTIVE);
      for (int k = 0; k < 3; k++) scene.clip.planes[0][k] = sqrt(1 / 3.0);
      scene.clip.planes[0][3] = -20 * sqrt(3) + clip[view], scene.clip.n_planes = 1;
      tc_scene_set_surfaces(&scene, g_memdup2(&own, sizeof own), 1);
      looked_at[boxed][view] = test_draw(test_widest(), volume, &scene, &request, NULL)->stats.looked_at;
    }
  }
  for (int boxed = 0; boxed < 2; boxed++)
    print_message("  %s: of %zu vertices %zu, %zu, %zu\n", boxed ? "with its box" : "without", ball->n_vertices, (size_t)looked_at[boxed][0],
                  (size_t)looked_at[boxed][1], (size_t)looked_at[boxed][2]);
  assert_true(looked_at[0][0] == ball->n_vertices && looked_at[1][0] == 0);
  for (int boxed = 0; boxed < 2; boxed++)
    assert_true(looked_at[boxed][1] == ball->n_vertices && looked_at[boxed][2] > 0 && looked_at[boxed][2] < ball->n_vertices);
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

TESTS(test_renderers_open, test_renderers_close)
