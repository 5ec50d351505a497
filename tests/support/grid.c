#include "tests/support/grid.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static void store(void *voxels, tc_voxel_type type, size_t i, double v) {
  static const double lo[] = {0, -128, 0, -32768}, hi[] = {255, 127, 65535, 32767};
  if (type != TC_F32) v = fmin(fmax(nearbyint(v), lo[type]), hi[type]);
  switch (type) {
  case TC_U8: ((uint8_t *)voxels)[i] = (uint8_t)v; break;
  case TC_I8: ((int8_t *)voxels)[i] = (int8_t)v; break;
  case TC_U16: ((uint16_t *)voxels)[i] = (uint16_t)v; break;
  case TC_I16: ((int16_t *)voxels)[i] = (int16_t)v; break;
  case TC_F32: ((float *)voxels)[i] = (float)v; break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

static tc_volume_desc describe(const test_grid *grid) {
  tc_volume_desc desc = {.type = grid->type, .slope = grid->slope, .intercept = grid->intercept, .frames = 1};
  bool turned = false;
  if (desc.slope == 0) desc.slope = 1;
  for (int i = 0; i < 9; i++) turned |= grid->direction[i] != 0;
  for (int i = 0; i < 9; i++) desc.direction[i] = turned ? grid->direction[i] : i % 4 == 0;
  for (int k = 0; k < 3; k++) {
    desc.dims[k] = grid->dims[k];
    desc.spacing[k] = grid->spacing[k] != 0 ? grid->spacing[k] : 1;
    desc.origin[k] = grid->origin[k];
  }
  strcpy(desc.format, "demo");
  return desc;
}

tc_volume *test_volume(const test_grid *grid, test_field field, const void *context) {
  tc_volume_desc desc = describe(grid);
  GError *error = NULL;
  tc_volume *volume = tc_volume_new(&desc, &error);
  if (!volume) {
    fprintf(stderr, "test volume: %s\n", error->message);
    exit(99);
  }
  void *voxels = tc_volume_voxels(volume);
  size_t i = 0;
  for (int z = 0; z < desc.dims[2]; z++)
    for (int y = 0; y < desc.dims[1]; y++)
      for (int x = 0; x < desc.dims[0]; x++, i++)
        store(voxels, desc.type, i, (field(x, y, z, context) - desc.intercept) / desc.slope);
  tc_volume_seal(volume);
  return volume;
}

double test_constant(double x, double y, double z, const void *value) { return *(const double *)value; }

double test_linear(double x, double y, double z, const void *plane) {
  const double *p = plane;
  return p[0] * x + p[1] * y + p[2] * z + p[3];
}

double test_radius2(double x, double y, double z, const void *center) {
  const double *c = center;
  return (x - c[0]) * (x - c[0]) + (y - c[1]) * (y - c[1]) + (z - c[2]) * (z - c[2]);
}

double test_waves(double x, double y, double z, const void *wavelength) {
  double w = 2 * M_PI / *(const double *)wavelength;
  return 0.5 + (sin(w * x + 0.3) + sin(w * 0.83 * y + 1.1) + sin(w * 1.13 * z + 2.0)) / 6;
}

double test_random(uint64_t *state) {
  *state += 0x9e3779b97f4a7c15u;
  uint64_t v = *state;
  v = (v ^ v >> 30) * 0xbf58476d1ce4e5b9u;
  v = (v ^ v >> 27) * 0x94d049bb133111ebu;
  return (double)((v ^ v >> 31) >> 11) * 0x1p-53;
}

double test_noise(double x, double y, double z, const void *seed) {
  uint64_t state = *(const unsigned *)seed + (uint64_t)x * 73856093u + ((uint64_t)y << 20) * 19349663u +
                   ((uint64_t)z << 40) * 83492791u;
  return test_random(&state);
}

void test_scene(tc_scene *scene, int width, int height) {
  tc_scene_init(scene);
  scene->image.width = width;
  scene->image.height = height;
  scene->sampling.termination = 0;
  scene->shading.gradient = TC_GRADIENT_CELL; /* references of central differences, the default, take longer */
}

const tc_knot test_soft[4] = {{.value = 0, .color = {0.1, 0.2, 1}, .amount = 0},
                              {.value = 0.45, .color = {1, 0.9, 0.2}, .amount = 0.02},
                              {.value = 0.8, .color = {1, 0.1, 0}, .amount = 0.2},
                              {.value = 1, .color = {1, 1, 1}, .amount = 0.05}};

void test_scene_knots(tc_scene *scene, tc_knot_kind kind, const tc_knot *knots, size_t count) {
  tc_transfer_function *tf = &scene->transfer_function;
  g_free(tf->points);
  tf->points = g_memdup2(knots, count * sizeof *knots);
  tf->count = count;
  tf->kind = kind;
  tf->unit_distance_mm = 1;
  tf->preset[0] = 0;
}

void test_scene_look(tc_scene *scene, tc_projection projection, const double from[3], const double to[3], double size) {
  tc_camera *camera = &scene->camera;
  double d[3], largest = 0;
  camera->projection = projection;
  for (int k = 0; k < 3; k++) {
    camera->position[k] = from[k];
    camera->target[k] = to[k];
    camera->up[k] = 0;
    d[k] = to[k] - from[k];
    largest = fmax(largest, fabs(d[k]));
  }
  camera->up[fabs(d[2]) < 0.9 * largest ? 2 : fabs(d[1]) < 0.9 * largest ? 1 : 0] = 1;
  if (projection == TC_PERSPECTIVE)
    camera->fov_y_deg = size;
  else
    camera->height_mm = size;
}

void test_scene_frame(tc_scene *scene, const tc_volume *volume, tc_projection projection, const double side[3]) {
  double lo[3], hi[3], mid[3], center[3], corner[3], from[3], radius = 0, length = 0;
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) mid[k] = 0.5 * (lo[k] + hi[k]);
  tc_volume_index_to_lps(volume, mid, center);
  for (int c = 0; c < 8; c++) {
    for (int k = 0; k < 3; k++) mid[k] = c >> k & 1 ? hi[k] : lo[k];
    tc_volume_index_to_lps(volume, mid, corner);
    radius = fmax(radius, hypot(hypot(corner[0] - center[0], corner[1] - center[1]), corner[2] - center[2]));
  }
  for (int k = 0; k < 3; k++) length += side[k] * side[k];
  double distance = projection == TC_PERSPECTIVE ? radius / sin(M_PI / 12) : 3 * radius;
  for (int k = 0; k < 3; k++) from[k] = center[k] + side[k] / sqrt(length) * distance;
  test_scene_look(scene, projection, from, center, projection == TC_PERSPECTIVE ? 30 : 2 * radius);
}
