/* Random cases, and volumes of many layers, for tests of what cuts a frame. */
#ifndef TC_TESTS_SUBJECT_H
#define TC_TESTS_SUBJECT_H

#include "tests/support/cases.h"
#include "tests/support/grid.h"
#include "tests/support/renderers.h"
#include "tests/support/test.h"

enum { CASES = SANITIZED ? 60 : 300 };

/* A case that every back end draws, with larger pictures than cases have: of several units. */
typedef struct subject {
  test_case drawn;
  tc_volume *volume, *labels;
  tc_render_request request;
} subject;

/* The modes of random cases, and in every fourth one those that draw surfaces and splats. */
static inline void choose_mode(tc_scene *scene, uint64_t seed) {
  if (seed % 4 == 0) scene->mode = seed % 8 == 0 ? TC_MODE_MESH : TC_MODE_SPLAT;
}

static inline bool subject_open(subject *s, uint64_t seed) {
  char *refusal = NULL;
  s->drawn = test_case_random(seed);
  choose_mode(&s->drawn.scene, seed);
  s->drawn.scene.image.width = 30 + (int)(seed % 41);
  s->drawn.scene.image.height = 20 + (int)(seed % 31);
  if (!test_case_fit(&s->drawn, &refusal)) {
    g_free(refusal);
    return false;
  }
  s->volume = test_case_volume(&s->drawn);
  s->labels = test_case_labels(&s->drawn, s->volume);
  s->request = (tc_render_request){.want_linear = seed % 2, .want_depth = seed % 3 == 0, .labels = s->labels,
                                   .table_size = s->drawn.table_size};
  return true;
}

static inline void subject_close(subject *s) {
  for (int i = 0; i < RENDERERS; i++)
    if (test_renderers[i]) tc_renderer_forget(test_renderers[i], s->volume);
  for (int i = 0; i < RENDERERS && s->labels; i++)
    if (test_renderers[i]) tc_renderer_forget(test_renderers[i], s->labels);
  tc_volume_unref(s->volume);
  tc_volume_unref(s->labels);
}

static inline tc_volume *ramp_of(tc_voxel_type type, int side) {
  test_grid grid = {.dims = {side, side, side}, .type = type, .slope = 1};
  const double plane[4] = {65535.0 / (side * side * side - 1), plane[0] * side, plane[1] * side, 0};
  return test_volume(&grid, test_linear, plane);
}

/* Faint surfaces one behind the other in every sample of a tile. */
static inline void deep_scene(subject *s, int n_panes, int rays_per_pixel) {
  tc_scene *scene = &s->drawn.scene;
  test_scene(scene, 64, 64);
  test_scene_frame(scene, s->volume, TC_ORTHOGRAPHIC, (const double[3]){0.05, 0.02, -1}); /* along the ramp */
  tc_mesh_surface *panes = g_new(tc_mesh_surface, n_panes);
  for (int i = 0; i < n_panes; i++)
    panes[i] = (tc_mesh_surface){.source = TC_SURFACE_OF_VALUE, .value = 65535.0 * (i + 1) / (n_panes + 1), .opacity = 0.01,
                                 .visible = true, .two_sided = true};
  tc_scene_set_surfaces(scene, panes, (size_t)n_panes);
  scene->mode = TC_MODE_MESH;
  scene->sampling.rays_per_pixel = rays_per_pixel;
}

#endif
