/* The truth of mode mesh: whatever a scene lists has the exact surfaces, of each its colour, shading and layers; it is bounded,
 * and given up when told. */
#include <pthread.h>
#include <time.h>

#include "renderer/quality/meter.h"
#include "renderer/reference/reference.h"
#include "tests/support/mesh.h"

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
    double off[6] = {0};
    for (int i = 0; i < 6; i += STRIDE(5)) { /* what is drawn, against a truth that lacks one thing from i = 1 on */
      g_auto(tc_scene) truth;
      tc_scene_copy(&truth, &scene);
      tc_scene_set_surfaces(&truth, g_memdup2(scene.mesh.surfaces, sizeof list), 4);
      if (i && i < 5) truth.mesh.surfaces[i - 1].visible = false;
      if (i == 5) truth.mesh.n_lights = 0;
      off[i] = error_of_drawn(volume, labels, meshes, &scene, &truth);
    }
    print_message("  %s: rms %.1e; without each %.3f %.3f %.3f %.3f, lights %.3f\n", tc_mode_names[modes[m]], off[0], off[1], off[2], off[3], off[4], off[5]);
    assert_true(off[0] < 0.012);
    for (int i = STRIDE(5); i < 6; i++) assert_true(off[i] > 2 * off[0]);
  }
}

/* The same in thick slices whose outlines differ by a pixel or two, and a line of single pixels. */
static double in_slices(double x, double y, double z, const void *user) {
  const double square = pow(x - 20, 2) + pow(y - 20, 2) + 9 * pow(z - 5, 2);
  return x == 5 && y == 20 ? 3 : square < ((int)z % 2 ? 150 : 190) ? 1 + (x > 20) : 0;
}

static void check_labels(const test_grid *grid, double (*of)(double, double, double, const void *), double bound) {
  g_autoptr(tc_volume) labels = test_volume(grid, of, NULL);
  g_auto(tc_scene) scene, truth;
  mesh_scene(&scene, labels, TC_PERSPECTIVE);
  scene.shading.model = TC_SHADING_LAMBERT, scene.labels.opacity = 1;
  g_strlcpy(scene.labels.volume, "labels", sizeof scene.labels.volume);
  const double off = error_of_drawn(labels, labels, NULL, &scene, &scene);
  tc_scene_copy(&truth, &scene);
  tc_scene_set_visible(&truth, g_memdup2((const uint32_t[1]){1}, sizeof(uint32_t)), 1);
  const double without = error_of_drawn(labels, labels, NULL, &scene, &truth);
  print_message("  rms %.1e, without one %.3f\n", off, without);
  assert_true(off < bound && without > 4 * off);
}

/* Without a list a mesh is every label. */
TEST(labels_have_a_truth) {
  check_labels(&(test_grid){.dims = {40, 40, 40}, .type = TC_U8, .slope = 1}, in_two_halves, 0.012);
  check_labels(&(test_grid){.dims = {40, 40, 10}, .spacing = {1, 1, 4}, .type = TC_U8, .slope = 1}, in_slices, 0.03); /* a pixel or two on seams of labels */
  check_labels(&(test_grid){.dims = {40, 40, 10}, .spacing = {0.5, 0.7, 1.6}, .type = TC_U8, .slope = 1}, in_slices, 0.03); /* a pixel or two on seams of labels */
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

/* Seconds that the program has computed, on all threads: what else the machine does counts little. */
static double computed(void) {
  struct timespec t;
  clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
  return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

typedef struct canceller {
  atomic_bool cancel;
  double after; /* of computed() */
  double at;    /* of computed(), read after cancelling: a thread that waits for a core between the two makes no late answer */
} canceller;

static void *cancel_later(void *data) {
  canceller *c = data;
  while (computed() < c->after) g_usleep(200);
  atomic_store(&c->cancel, true);
  c->at = computed();
  return NULL;
}

/* Seconds computed after the truth was given up `after` seconds from its begin; infinite if it was finished before. */
static double computed_after_cancelling(tc_meter_subject subject, double after, bool *made) {
  canceller c = {.after = computed() + after};
  g_autoptr(GError) error = NULL;
  pthread_t thread;
  subject.cancel = &c.cancel;
  assert_int_equal(pthread_create(&thread, NULL, cancel_later, &c), 0);
  tc_reference *truth = tc_meter_reference(&subject, 8, 8, &error);
  const double end = computed();
  while (computed() < c.after) {} /* made sooner than before */
  pthread_join(thread, NULL);
  *made = truth != NULL;
  assert_true(truth || g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED));
  tc_reference_free(truth);
  return *made ? INFINITY : end - c.at;
}

/* A truth of a large mesh without normals that is cancelled in any phase of its making ends after a small share of the work.
 * The least of a few tries counts, because on a busy machine the making thread may run on before it sees the flag. */
TEST(making_a_truth_is_cancelled) {
  enum { MOMENTS = SANITIZED ? 6 : 24, TRIES = 6 };
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
  const tc_meter_subject subject = {volume, NULL, meshes, &scene, NULL};
  const double begun = computed();
  tc_reference_free(tc_meter_reference(&subject, 8, 8, NULL));
  const double whole = computed() - begun;
  double most = 0;
  int cancelled = 0;
  for (int i = 0; i < MOMENTS; i++) {
    double least = INFINITY;
    for (int n = 0; n < TRIES && least > whole / 48; n++) {
      bool made;
      least = fmin(least, computed_after_cancelling(subject, whole * i / (MOMENTS + 4), &made));
      assert_true(!made || i > MOMENTS / 2);
    }
    if (isfinite(least)) most = fmax(most, least), cancelled++;
  }
  print_message("  computed for %.0f ms, %.1f after it was given up\n", 1000 * whole, 1000 * most);
  assert_true(cancelled > MOMENTS / 2);
  assert_true(most < whole / 24);
}

TESTS(test_renderers_open, test_renderers_close)
