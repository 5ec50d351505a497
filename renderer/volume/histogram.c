#include "renderer/volume/histogram.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/volume/voxel.h"

typedef struct binning {
  double slope, intercept, lo, scale;
  int bins;
  uint64_t *counts;
} binning;

static void count_voxels(const binning *b, double voxel, uint64_t n) {
  double at = (b->slope * voxel + b->intercept - b->lo) * b->scale;
  /* `at` may be infinite or NaN if the range is tiny */
  b->counts[at < b->bins ? at > 0 ? (int)at : 0 : at >= b->bins ? b->bins - 1 : 0] += n;
}

static void count_voxel(void *user, double voxel) { count_voxels(user, voxel, 1); }

/* Integers without NaN voxels: counts each of the at most 65536 values first. False: out of memory. */
static bool count_integers(const binning *b, tc_voxel_type type, const void *voxels, size_t n) {
  const bool wide = tc_voxel_size(type) == 2;
  uint64_t *of = calloc(65536, sizeof *of);
  for (size_t i = 0; of && i < n; i++) of[wide ? ((const uint16_t *)voxels)[i] : ((const uint8_t *)voxels)[i]]++;
  for (unsigned raw = 0; of && raw < 65536; raw++)
    if (of[raw]) count_voxels(b, type == TC_I8 ? (int8_t)raw : type == TC_I16 ? (int16_t)raw : (int)raw, of[raw]);
  free(of);
  return of != NULL;
}

void tc_volume_histogram(const tc_volume *volume, int bins, uint64_t *counts, double *edges) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *stats = tc_volume_statistics(volume);
  const tc_sparse *sparse = tc_volume_sparse(volume);
  const tc_volume *gaps = tc_volume_gaps(volume);
  const double lo = stats->min, hi = stats->max;
  binning b = {d->slope, d->intercept, lo, hi > lo ? bins / (hi - lo) : 0, bins, counts};
  for (int i = 0; i <= bins; i++) edges[i] = lo + (hi - lo) * i / bins;
  memset(counts, 0, (size_t)bins * sizeof *counts);
  if (sparse) {
    sparse->each(sparse->model, count_voxel, &b);
    return;
  }
  const size_t n = tc_volume_bytes(volume) / tc_voxel_size(d->type);
  const void *voxels = tc_volume_data(volume);
  const uint8_t *hidden = gaps ? tc_volume_data(gaps) : NULL;
  if (d->type != TC_F32 && !gaps && count_integers(&b, d->type, voxels, n)) return;
  for (size_t i = 0; i < n; i++)
    if (!hidden || !hidden[i]) count_voxels(&b, tc_voxel_at(d->type, voxels, i), 1);
}
