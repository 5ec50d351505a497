#include "renderer/skip/fine.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/base/clock.h"
#include "renderer/base/reserve.h"
#include "renderer/skip/empty_ranges.h"
#include "renderer/skip/minmax_each.h"
#include "renderer/volume/voxel.h"

#define LEVELS 65536
#define BINS 256
#define SAMPLED (1 << 18) /* approximate number of voxels in the histogram from which bins are chosen */
#define MOST_WIDTH 64 /* of a fine box, voxels */

/* The level of a value. NaN goes to the first level, as table look-ups take it to the first node. */
static int level_of(const tc_fine *f, double voxel) {
  double level = (voxel - f->lo) * f->scale;
  return level > 0 ? level < f->levels - 1 ? (int)level : f->levels - 1 : 0;
}

/* Assigns a bin to each level: half by the cumulative share of voxels at the level's middle, half by its position in
 * the range. */
static bool fill_bins(tc_fine *f, const tc_volume *volume) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  const int from = level_of(f, s->voxel_min), to = level_of(f, s->voxel_max);
  const size_t count = (size_t)d->dims[0] * (size_t)d->dims[1] * (size_t)d->dims[2];
  const size_t stride = count / SAMPLED | 1;
  const void *voxels = tc_volume_data(volume);
  uint32_t *counts = calloc(LEVELS, sizeof *counts), sampled = 0;
  if (!counts) return false;
  for (size_t i = 0; i < count; i += stride, sampled++) counts[level_of(f, tc_voxel_at(d->type, voxels, i))]++;
  double sum = 0;
  for (int i = 0; i < LEVELS; i++) {
    double share = 0.5 * counts[i] / sampled + (i >= from && i <= to ? 0.5 / (to - from + 1) : 0);
    double bin = (sum + 0.5 * share) * BINS;
    f->bins[i] = bin < BINS - 1 ? (uint8_t)bin : BINS - 1;
    sum += share;
  }
  free(counts);
  return true;
}

static void set_levels(tc_fine *f, const tc_volume *volume) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  const tc_voxel_type type = f->grid.type;
  double range = s->voxel_max - s->voxel_min;
  f->levels = tc_voxel_size(type) == 1 ? BINS : LEVELS;
  f->lo = type == TC_I8 ? -128 : type == TC_I16 ? -32768 : type == TC_F32 ? s->voxel_min : 0;
  f->scale = type != TC_F32 ? 1 : range > 0 ? (LEVELS - 1) / range : 0;
}

/* Sets the number of fine boxes of this width, and of groups, along each axis; the bytes of a plane of each. */
static void set_width(tc_fine *f, const tc_volume *volume, int width, size_t *plane, size_t *groups) {
  f->grid.block = width;
  *plane = tc_minmax_blocks(volume, width, f->grid.blocks) + TC_FINE_PAD;
  f->groups = (f->grid.blocks[0] + TC_FINE_GROUP - 1) / TC_FINE_GROUP;
  *groups = (size_t)f->groups * (size_t)f->grid.blocks[1] * (size_t)f->grid.blocks[2] + TC_FINE_PAD;
}

static bool reserve(tc_fine *f, const tc_volume *volume, int block, size_t most_bytes) {
  size_t plane, groups;
  set_width(f, volume, block / 2 > 2 ? block / 2 : 2, &plane, &groups);
  while (2 * (plane + groups) > most_bytes && f->grid.block < MOST_WIDTH)
    set_width(f, volume, f->grid.block + 1, &plane, &groups);
  f->bytes = 2 * (plane + groups) + (size_t)f->levels;
  f->least = tc_reserve(f->bytes, 1);
  if (!f->least) return false;
  f->most = f->least + plane;
  f->group_least = f->most + plane;
  f->group_most = f->group_least + groups;
  f->bins = f->group_most + groups;
  for (int i = 0; i < TC_FINE_PAD; i++) f->least[plane - 1 - (size_t)i] = f->most[plane - 1 - (size_t)i] = 0;
  return true;
}

tc_fine *tc_fine_begin(const tc_volume *volume, int block, int reach, size_t most_bytes, GError **error) {
  double start = tc_now_ms();
  tc_fine *f = calloc(1, sizeof *f);
  if (f) {
    f->grid = (tc_minmax){.reach = reach, .type = tc_volume_describe(volume)->type};
    set_levels(f, volume);
    bool made = reserve(f, volume, block, most_bytes);
    for (int i = 0; made && i < BINS && f->levels == BINS; i++) f->bins[i] = (uint8_t)i;
    if (made && (f->levels == BINS || fill_bins(f, volume))) {
      f->build_ms = tc_now_ms() - start;
      return f;
    }
  }
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "minima and maxima of fine boxes: out of memory");
  tc_fine_free(f);
  return NULL;
}

/* ---- minima and maxima ---- */

#define BIN(type, level)                                                                                               \
  {                                                                                                                    \
    const type *p = pairs;                                                                                             \
    size_t i = 0;                                                                                                      \
    for (; i + 8 <= count; i += 8) {                                                                                   \
      uint64_t lo = 0, hi = 0;                                                                                         \
      _Pragma("GCC unroll 8") for (size_t k = 0; k < 8; k++) {                                                         \
        lo |= (uint64_t)bins[level(p[2 * (i + k)])] << 8 * k;                                                          \
        hi |= (uint64_t)bins[level(p[2 * (i + k) + 1])] << 8 * k;                                                      \
      }                                                                                                                \
      memcpy(least + i, &lo, sizeof lo), memcpy(most + i, &hi, sizeof hi);                                             \
    }                                                                                                                  \
    for (; i < count; i++) least[i] = bins[level(p[2 * i])], most[i] = bins[level(p[2 * i + 1])];          \
    return;                                                                                                            \
  }
#define AS_IS(v) v
#define FROM_I8(v) (v + 128)
#define FROM_I16(v) (v + 32768)
#define OF_FLOAT(v) level_of(f, (double)v)
static void bin(const tc_fine *f, size_t first, size_t count, const void *pairs) {
  const uint8_t *restrict bins = f->bins;
  uint8_t *restrict least = f->least + first, *restrict most = f->most + first;
  switch (f->grid.type) {
  case TC_U8: BIN(uint8_t, AS_IS)
  case TC_I8: BIN(int8_t, FROM_I8)
  case TC_U16: BIN(uint16_t, AS_IS)
  case TC_I16: BIN(int16_t, FROM_I16)
  case TC_F32: BIN(float, OF_FLOAT)
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

/* Minima and maxima over the groups of a row. */
static void group_row(const tc_fine *f, size_t row) {
  const int n = f->grid.blocks[0];
  const uint8_t *least = f->least + row * (size_t)n, *most = f->most + row * (size_t)n;
  for (int g = 0; g < f->groups; g++) {
    const int end = n < (g + 1) * TC_FINE_GROUP ? n : (g + 1) * TC_FINE_GROUP;
    uint8_t lo = 255, hi = 0;
    for (int x = g * TC_FINE_GROUP; x < end; x++) {
      lo = least[x] < lo ? least[x] : lo;
      hi = most[x] > hi ? most[x] : hi;
    }
    f->group_least[row * (size_t)f->groups + (size_t)g] = lo;
    f->group_most[row * (size_t)f->groups + (size_t)g] = hi;
  }
}

/* A tc_minmax_sink. */
static void take(void *user, size_t first, size_t count, const void *pairs) {
  const tc_fine *f = user;
  const size_t n = (size_t)f->grid.blocks[0];
  bin(f, first, count, pairs);
  for (size_t row = first / n; row < (first + count) / n; row++) group_row(f, row);
}

bool tc_fine_go_on(tc_fine *f, const tc_volume *volume, tc_pool *pool, GError **error) {
  const double start = tc_now_ms();
  const bool made = tc_minmax_each(&f->grid, volume, pool, take, f, error);
  f->build_ms += tc_now_ms() - start;
  return made;
}

void tc_fine_free(tc_fine *fine) {
  if (!fine) return;
  free(fine->least);
  free(fine);
}

/* ---- ranges ---- */

/* The set of all values of the levels [first, last]: those of both ends, since a range is an interval. Levels of floats
 * reach one further for rounding. */
static uint8_t set_of(const tc_fine *f, const tc_empty_ranges *ranges, int first, int last) {
  const bool real = f->grid.type == TC_F32;
  const double level = f->scale > 0 ? 1 / f->scale : 0;
  return tc_empty_ranges_set(ranges, f->lo + (first - real) * level) &
         tc_empty_ranges_set(ranges, f->lo + (last + 2 * real) * level);
}

bool tc_fine_find_ranges(const tc_fine *f, const tc_support *support, tc_fine_ranges *found, GError **error) {
  tc_empty_ranges ranges;
  int first[TC_FINE_RANGES], last[TC_FINE_RANGES];
  if (!tc_empty_ranges_init(&ranges, support, TC_F32, error))
    return false; /* TC_F32: the sets at nodes suffice, one for every voxel value is not needed */
  for (int r = 0; r < TC_FINE_RANGES; r++) first[r] = BINS, last[r] = -1;
  for (int i = 0, end; i < f->levels; i = end) {
    const int bin = f->bins[i];
    for (end = i + 1; end < f->levels && f->bins[end] == bin; end++) continue;
    const uint8_t set = set_of(f, &ranges, i, end - 1);
    for (int r = 0; r < TC_FINE_RANGES; r++) {
      if (!(set >> r & 1)) continue;
      if (first[r] > bin) first[r] = bin;
      last[r] = bin;
    }
  }
  tc_empty_ranges_finish(&ranges);
  found->count = 0;
  for (int r = 0; r < TC_FINE_RANGES; r++) {
    if (first[r] > last[r]) continue;
    found->first[found->count] = (uint8_t)first[r];
    found->last[found->count++] = (uint8_t)last[r];
  }
  return true;
}
