/* Scenes of mode mesh for its tests. */
#ifndef TC_TEST_MESH_H
#define TC_TEST_MESH_H

#include "tests/support/test.h"

#include "renderer/tomocast.h"
#include "tests/support/grid.h"
#include "tests/support/renderers.h"

enum { SIDE = 90, PIXELS = SIDE * SIDE };

static inline tc_volume *waves(tc_voxel_type type) {
  return test_volume(&(test_grid){.dims = {40, 36, 38}, .type = type, .slope = type == TC_F32 ? 1 : 0.004,
                                  .spacing = {1, 1.3, 0.8}}, test_waves, &(double){24});
}

static inline void mesh_scene(tc_scene *scene, const tc_volume *volume, tc_projection projection) {
  test_scene(scene, SIDE, SIDE);
  test_scene_frame(scene, volume, projection, (double[3]){1, -0.6, 0.4});
  scene->mode = TC_MODE_MESH;
  scene->isosurface.value = 0.55;
  scene->shading.model = TC_SHADING_BLINN_PHONG;
}

#endif
