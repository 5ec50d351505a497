/* A model as a volume like any other: without a grid. */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "renderer/splat/normal.h"
#include "renderer/splat/vmd.h"

#define MOST_VALUE 1e30f /* as in a volume with a grid, whose larger ones are scaled */

const tc_vmd_attribute *tc_vmd_value_attribute(const tc_vmd_head *head) {
  const tc_vmd_attribute *a = tc_vmd_attribute_named(head, "value");
  if (!a) a = tc_vmd_attribute_named(head, "label");
  return a && a->type != TC_VMD_NORMAL ? a : NULL;
}

static bool voxel(const void *model, const int at[3], double *value) {
  const tc_vmd *vmd = model;
  const uint8_t *record = tc_vmd_voxel(vmd, at[0], at[1], at[2]);
  const tc_vmd_attribute *a = tc_vmd_value_attribute(&vmd->head);
  if (record) *value = a ? tc_vmd_number(a, record) : 1;
  return record != NULL;
}

static void each(const void *model, void (*seen)(void *user, double voxel), void *user) {
  const tc_vmd *vmd = model;
  const tc_vmd_attribute *a = tc_vmd_value_attribute(&vmd->head);
  for (uint32_t c = 0; c < vmd->columns; c++)
    for (tc_vmd_run run = {.at = vmd->bytes + tc_vmd_start(vmd, c)}; tc_vmd_next(vmd, &run);)
      for (int i = 0; i < run.count; i++) seen(user, a ? tc_vmd_number(a, run.records + (size_t)i * run.step) : 1);
}

typedef struct range {
  double lo, hi;
  bool bad;
} range;

static void widen(void *user, double voxel) {
  range *r = user;
  if (!(fabs(voxel) <= (double)MOST_VALUE)) r->bad = true;
  if (voxel < r->lo) r->lo = voxel;
  if (voxel > r->hi) r->hi = voxel;
}

/* Ranges of all attributes; a run of equal records counts once. */
static void find_ranges(tc_vmd *vmd) {
  const int n = vmd->head.n_attributes;
  for (int i = 0; i < n; i++) vmd->range[i][0] = INFINITY, vmd->range[i][1] = -INFINITY;
  for (uint32_t c = 0; c < vmd->columns; c++)
    for (tc_vmd_run run = {.at = vmd->bytes + tc_vmd_start(vmd, c)}; tc_vmd_next(vmd, &run);)
      for (int i = 0; i < (run.step ? run.count : 1); i++)
        for (int a = 0; a < n; a++) {
          const double number = tc_vmd_number(&vmd->head.attributes[a], run.records + (size_t)i * run.step);
          if (!isfinite(number)) continue;
          if (number < vmd->range[a][0]) vmd->range[a][0] = number;
          if (number > vmd->range[a][1]) vmd->range[a][1] = number;
        }
  for (int i = 0; i < n; i++)
    if (vmd->range[i][0] > vmd->range[i][1]) vmd->range[i][0] = vmd->range[i][1] = 0;
}

static void free_model(void *model) { tc_vmd_free(model); }

tc_volume *tc_vmd_volume(tc_vmd *vmd, GError **error) {
  const tc_vmd_attribute *a = tc_vmd_value_attribute(&vmd->head);
  tc_volume_desc d = vmd->head.grid;
  range r = {INFINITY, -INFINITY, false};
  each(vmd, widen, &r);
  if (r.bad) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "voxel model: a value is not finite; convert the volume again");
    return NULL;
  }
  if (!vmd->voxels) r.lo = r.hi = 0;
  find_ranges(vmd);
  d.type = a ? (tc_voxel_type)a->type : TC_U8;
  if (!a || strcmp(a->name, "value") != 0) d.slope = 1, d.intercept = 0;
  g_strlcpy(d.format, "vmd", sizeof d.format);
  snprintf(d.note, sizeof d.note, "a run-length model of %llu voxels in %llu runs", (unsigned long long)vmd->voxels,
           (unsigned long long)vmd->runs);
  return tc_volume_of_sparse(&d, &(tc_sparse){vmd, vmd->total_bytes, r.lo, r.hi, voxel, each, free_model}, error);
}

/* The stored voxel of what is free. */
static double free_voxel(const tc_volume *volume) {
  static const double lowest[TC_VOXEL_TYPE_COUNT] = {
      [TC_I8] = INT8_MIN, [TC_I16] = INT16_MIN, [TC_F32] = -2 * (double)MOST_VALUE};
  const double least = tc_volume_statistics(volume)->voxel_min;
  return least > 0 ? 0 : fmax(least - 1, lowest[tc_volume_describe(volume)->type]);
}

tc_volume *tc_vmd_grid(const tc_volume *volume, GError **error) {
  const tc_vmd *vmd = tc_volume_model(volume);
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_vmd_attribute *a = tc_vmd_value_attribute(&vmd->head);
  const size_t size = tc_voxel_size(d->type), nx = (size_t)d->dims[0], ny = (size_t)d->dims[1];
  tc_volume *grid = tc_volume_new(d, error);
  uint8_t blank[4], one[4], *voxels = grid ? tc_volume_voxels(grid) : NULL;
  if (!grid) return NULL;
  tc_vmd_store(d->type, free_voxel(volume), blank), tc_vmd_store(d->type, 1, one);
  for (size_t i = 0; i < nx * ny * (size_t)d->dims[2]; i++) memcpy(voxels + i * size, blank, size);
  for (int y = 0; y < d->dims[1]; y++)
    for (int x = 0; x < d->dims[0]; x++)
      for (tc_vmd_run run = {.at = tc_vmd_column(vmd, x, y)}; tc_vmd_next(vmd, &run);)
        for (int i = 0; i < run.count; i++)
          memcpy(voxels + (((size_t)(run.z + i) * ny + (size_t)y) * nx + (size_t)x) * size,
                 a ? run.records + (size_t)i * run.step + a->at : one, size);
  tc_volume_seal(grid);
  return grid;
}

void tc_vmd_normal(const tc_vmd_attribute *attribute, const uint8_t *record, double normal[3]) {
  float n[3];
  tc_octahedron_unfold(record[attribute->at], record[attribute->at + 1], 127, n);
  for (int k = 0; k < 3; k++) normal[k] = (double)n[k];
}

double tc_vmd_own_normal(const void *model, int x, int y, int z, double normal[3]) {
  const tc_vmd *vmd = model;
  const tc_vmd_attribute *a = tc_vmd_attribute_named(&vmd->head, "normal");
  const uint8_t *record = a && a->type == TC_VMD_NORMAL ? tc_vmd_voxel(vmd, x, y, z) : NULL;
  memset(normal, 0, 3 * sizeof *normal);
  if (record) tc_vmd_normal(a, record, normal);
  return -1;
}
