#include "renderer/volume/values.h"

#include <math.h>
#include <stdlib.h>

#define BINS 65536
/* Padding requires at least this many other values: masks and labels have fewer. */
#define FEW_VALUES 16
/* Padding below the range is at least this many widths of the range away. */
#define FAR_BELOW 4
#define FAR_ABOVE 1

struct tc_values {
  uint64_t counts[BINS];
  double start, width; /* value of bin 0's lower edge (for integers: of bin 0); width of a bin */
  int first, last;     /* bins of the range, inclusive */
};

/* In larger volumes, a sample of the rows suffices for the distribution of values. */
#define ENOUGH_VOXELS (1u << 24)

/* Bins ascend with the value, hence descend with the voxel if the slope is negative. Integers have a bin each. */
#define COUNT_OF(name, type, number)                                                                                 \
  static void count_##name(const type *v, size_t n, double start, double scale, uint64_t *counts) {                  \
    const number first = (number)start, times = (number)scale;                                                       \
    for (size_t i = 0; i < n; i++) {                                                                                 \
      const number at = ((number)v[i] - first) * times;                                                              \
      if (at >= 0 && at < BINS) counts[(int)at]++;                                                                   \
    }                                                                                                                \
  }
COUNT_OF(u8, uint8_t, int)
COUNT_OF(i8, int8_t, int)
COUNT_OF(u16, uint16_t, int)
COUNT_OF(i16, int16_t, int)
COUNT_OF(f32, float, double)

static void count_row(tc_values *values, tc_voxel_type type, const void *v, size_t n, double start, double scale) {
  switch (type) {
  case TC_U8: count_u8(v, n, start, scale, values->counts); break;
  case TC_I8: count_i8(v, n, start, scale, values->counts); break;
  case TC_U16: count_u16(v, n, start, scale, values->counts); break;
  case TC_I16: count_i16(v, n, start, scale, values->counts); break;
  case TC_F32: count_f32(v, n, start, scale, values->counts); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

typedef struct lone {
  tc_values *values;
  double start, scale;
} lone;

static void count_lone(void *user, double voxel) {
  const lone *l = user;
  const double at = (voxel - l->start) * l->scale;
  if (at >= 0 && at < BINS) l->values->counts[(int)at]++;
}

/* Counts voxels in [lo, hi], both of which occur. */
static void count(tc_values *values, const tc_volume *volume, double lo, double hi) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const bool whole = d->type != TC_F32;
  const double width = whole ? 1 : hi > lo ? (hi - lo) / (BINS - 1) : 1;
  const double start = d->slope > 0 ? lo : hi, scale = (d->slope > 0 ? 1 : -1) / width;
  const size_t size = tc_voxel_size(d->type), n = (size_t)d->dims[0], rows = (size_t)d->dims[1] * (size_t)d->dims[2];
  const size_t every = n * rows / ENOUGH_VOXELS + 1;
  const char *v = tc_volume_data(volume);
  for (int i = 0; i < BINS; i++) values->counts[i] = 0;
  const tc_sparse *sparse = tc_volume_sparse(volume);
  if (sparse) sparse->each(sparse->model, count_lone, &(lone){values, start, scale});
  for (size_t row = 0; row < rows && !sparse; row += every) count_row(values, d->type, v + row * n * size, n, start, scale);
  for (int end = 0; end < 2; end++) { /* lo and hi count even if the sampled rows miss them */
    const double at = ((end ? hi : lo) - start) * scale;
    uint64_t *c = &values->counts[at < BINS - 1 ? (int)at : BINS - 1];
    *c += *c == 0;
  }
  values->start = d->slope * start + d->intercept;
  values->width = fabs(d->slope) * width;
}

static int next_used(const tc_values *v, int bin, int step) {
  do bin += step;
  while (bin > v->first && bin < v->last && !v->counts[bin]);
  return bin;
}

static bool has_many(const tc_values *v, int from, int to) {
  int used = 0;
  for (int i = from; i <= to && used < FEW_VALUES; i++) used += v->counts[i] > 0;
  return used == FEW_VALUES;
}

/* Moves an end of the range past padding. False: no padding. */
static bool leave_padding(tc_values *v) {
  const int above = next_used(v, v->first, 1), below = next_used(v, v->last, -1);
  if (v->last - v->first < FEW_VALUES) return false;
  if (above - v->first > FAR_BELOW * (v->last - above)) v->first = above;
  else if (v->last - below > FAR_ABOVE * (below - v->first)) v->last = below;
  else return false;
  return true;
}

/* The range of an f32 volume's voxels within the remaining bins. */
static void range_within(const tc_values *v, const tc_volume *volume, double *lo, double *hi) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const double a = (v->start + v->width * v->first - d->intercept) / d->slope;
  const double b = (v->start + v->width * (v->last + 1) - d->intercept) / d->slope;
  const float from = (float)fmin(a, b), to = (float)fmax(a, b), *p = tc_volume_data(volume);
  float least = INFINITY, most = -INFINITY;
  for (size_t i = 0, n = tc_volume_bytes(volume) / sizeof *p; i < n; i++) {
    if (!(p[i] >= from && p[i] <= to)) continue;
    least = fminf(least, p[i]);
    most = fmaxf(most, p[i]);
  }
  *lo = least, *hi = most;
}

static void find_range(tc_values *v) {
  v->first = 0, v->last = BINS - 1;
  while (v->first < v->last && !v->counts[v->first]) v->first++;
  while (v->last > v->first && !v->counts[v->last]) v->last--;
}

tc_values *tc_values_of(const tc_volume *volume) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  tc_values *values = malloc(sizeof *values);
  if (!values) return NULL;
  count(values, volume, s->voxel_min, s->voxel_max);
  find_range(values);
  double lo = s->voxel_min, hi = s->voxel_max;
  const bool padded = !tc_volume_sparse(volume); /* a segmented object has no padding */
  for (int ends = 0; ends < 2 && padded && leave_padding(values); ends++) {
    if (d->type != TC_F32) continue; /* one bin per value: already exact */
    range_within(values, volume, &lo, &hi);
    count(values, volume, lo, hi);
    find_range(values);
  }
  if (has_many(values, values->first, values->last)) return values;
  count(values, volume, s->voxel_min, s->voxel_max); /* a mask: keep its ends */
  find_range(values);
  return values;
}

void tc_values_free(tc_values *values) { free(values); }

static double value_of(const tc_values *v, int bin) { return v->start + v->width * bin; }

void tc_values_range(const tc_values *values, double *low, double *high) {
  *low = value_of(values, values->first);
  *high = value_of(values, values->last);
}

static int bin_of(const tc_values *v, double value) {
  const double bin = ceil((value - v->start) / v->width - 1e-9);
  return bin > v->first ? bin < v->last ? (int)bin : v->last : v->first;
}

static double count_from(const tc_values *v, int bin) {
  double sum = 0;
  for (int i = bin; i <= v->last; i++) sum += (double)v->counts[i];
  return sum;
}

double tc_values_share(const tc_values *values, double value) {
  if (value > value_of(values, values->last)) return 0;
  return count_from(values, bin_of(values, value)) / count_from(values, values->first);
}

double tc_values_percentile(const tc_values *values, double from, double share) {
  int bin = bin_of(values, from);
  double left = share * count_from(values, bin);
  for (; bin < values->last && left >= (double)values->counts[bin]; bin++) left -= (double)values->counts[bin];
  return value_of(values, bin);
}

static int best_parting(const tc_values *v, int first) {
  double all = 0, total = 0, below = 0, sum = 0, most = -1;
  int best = first;
  for (int i = first; i <= v->last; i++) all += (double)v->counts[i], total += (double)v->counts[i] * i;
  for (int i = first + 1; i <= v->last; i++) {
    below += (double)v->counts[i - 1];
    sum += (double)v->counts[i - 1] * (i - 1);
    if (!(below > 0 && below < all)) continue;
    const double apart = sum / below - (total - sum) / (all - below), variance = below * (all - below) * apart * apart;
    if (variance > most) most = variance, best = i;
  }
  return best;
}

double tc_values_threshold(const tc_values *v) {
  const double half = 0.5 * count_from(v, v->first);
  const int best = best_parting(v, v->first);
  for (int i = best; i < v->last; i++)
    if ((double)v->counts[i] > half) return value_of(v, best_parting(v, i + 1));
  return value_of(v, best);
}
