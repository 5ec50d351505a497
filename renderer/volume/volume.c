#include "renderer/volume/provenance.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "renderer/volume/voxel.h"

/* Bytes of zeros after the last voxel: kernels read beyond it (pairs of voxels as 32 bits, whole vectors at row
 * ends). */
#define TAIL_PAD_BYTES 256

struct tc_volume {
  tc_volume_desc desc;
  tc_volume_stats stats;
  tc_provenance provenance;
  tc_sparse sparse;    /* .model NULL: there is a grid */
  uint8_t *voxels;
  tc_volume *gaps;     /* see tc_volume_gaps() */
  tc_volume *colors;   /* see tc_volume_colors() */
  tc_segment *segments;
  size_t n_segments;
  size_t bytes;        /* of the voxels */
  size_t mapped_bytes; /* with the pad */
  double to_lps[9];    /* index displacement -> mm, row by row */
  double to_index[9];
  uint64_t serial;
  atomic_int references;
  bool sealed;
  void (*freed)(void *user); /* or NULL */
  void *freed_user;
};

static atomic_uint_fast64_t next_serial = 1;

const char *tc_voxel_type_name(tc_voxel_type type) {
  static const char *const names[TC_VOXEL_TYPE_COUNT] = {"u8", "i8", "u16", "i16", "f32"};
  return (unsigned)type < TC_VOXEL_TYPE_COUNT ? names[type] : "?";
}

size_t tc_voxel_size(tc_voxel_type type) {
  static const size_t sizes[TC_VOXEL_TYPE_COUNT] = {1, 1, 2, 2, 4};
  return (unsigned)type < TC_VOXEL_TYPE_COUNT ? sizes[type] : 0;
}

/* Inverse of a 3x3 by cofactors; false when it is singular to rounding. */
static bool invert3(const double m[9], double inverse[9]) {
  double scale = 0;
  for (int i = 0; i < 9; i++) scale = fmax(scale, fabs(m[i]));
  double c[9] = {m[4] * m[8] - m[5] * m[7], m[2] * m[7] - m[1] * m[8], m[1] * m[5] - m[2] * m[4],
                 m[5] * m[6] - m[3] * m[8], m[0] * m[8] - m[2] * m[6], m[2] * m[3] - m[0] * m[5],
                 m[3] * m[7] - m[4] * m[6], m[1] * m[6] - m[0] * m[7], m[0] * m[4] - m[1] * m[3]};
  double det = m[0] * c[0] + m[1] * c[3] + m[2] * c[6];
  if (!(fabs(det) > 1e-9 * scale * scale * scale)) return false;
  for (int i = 0; i < 9; i++) inverse[i] = c[i] / det;
  return true;
}

static bool check_grid(const tc_volume_desc *d, GError **error) {
  for (int k = 0; k < 3; k++) {
    if (d->dims[k] < 1) {
      tc_set_error(error, TC_ERROR_INVALID, NULL, "volume: axis %d has %d voxels, at least 1 expected", k, d->dims[k]);
      return false;
    }
    if (!(d->spacing[k] > 0) || !isfinite(d->spacing[k])) {
      tc_set_error(error, TC_ERROR_INVALID, NULL, "volume: spacing of axis %d is %g, a finite number above 0 expected", k,
                   d->spacing[k]);
      return false;
    }
    if (!(fabs(d->origin[k]) <= 1e9)) { /* a million km: beyond, millimetres are lost to rounding */
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "volume: the origin %g mm is absurd; correct it in the file's header",
                   d->origin[k]);
      return false;
    }
  }
  if (!tc_scale_is_usable(d->slope, d->intercept)) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "volume: slope %g and intercept %g: at most %g are allowed, and a slope of at "
                 "least %g; correct them in the file's header", d->slope, d->intercept, TC_MOST_SCALE, 1 / TC_MOST_SCALE);
    return false;
  }
  if ((unsigned)d->type >= TC_VOXEL_TYPE_COUNT) {
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "volume: voxel type %d is unknown", (int)d->type);
    return false;
  }
  return true;
}

/* Normalises columns that are unit vectors up to a file's rounding; refuses all others. */
static bool normalise_direction(tc_volume_desc *d, double to_index[9], GError **error) {
  for (int k = 0; k < 3; k++) {
    double length = sqrt(d->direction[k] * d->direction[k] + d->direction[3 + k] * d->direction[3 + k] +
                         d->direction[6 + k] * d->direction[6 + k]);
    if (!isfinite(length) || length < 1e-6) {
      tc_set_error(error, TC_ERROR_INVALID, NULL, "volume: direction of axis %d is not a vector", k);
      return false;
    }
    for (int r = 0; r < 3; r++) d->direction[3 * r + k] /= length;
  }
  double inverse[9];
  if (!invert3(d->direction, inverse)) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "volume: the direction's axes lie in one plane");
    return false;
  }
  for (int k = 0; k < 3; k++)
    for (int c = 0; c < 3; c++) to_index[3 * k + c] = inverse[3 * k + c] / d->spacing[k];
  return true;
}

static bool check_voxels(const tc_volume_desc *d, GError **error) {
  uint64_t voxels = 1;
  for (int k = 0; k < 3; k++) {
    voxels *= (uint64_t)MAX(d->dims[k], 1); /* two factors below 2^31 fit; the product is checked before the third */
    if (voxels <= INT32_MAX) continue;
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "volume: %dx%dx%d is more than 2^31-1 voxels: crop or resample it first",
                 d->dims[0], d->dims[1], d->dims[2]);
    return false;
  }
  return true;
}

/* A volume with its geometry, without voxels. */
static tc_volume *placed(const tc_volume_desc *desc, GError **error) {
  if (!check_grid(desc, error)) return NULL;
  tc_volume *v = calloc(1, sizeof *v);
  if (!v) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "volume: out of memory");
    return NULL;
  }
  v->desc = *desc;
  if (v->desc.frames < 1) v->desc.frames = 1;
  if (!normalise_direction(&v->desc, v->to_index, error)) {
    free(v);
    return NULL;
  }
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 3; k++) v->to_lps[3 * r + k] = v->desc.direction[3 * r + k] * v->desc.spacing[k];
  v->serial = atomic_fetch_add(&next_serial, 1);
  atomic_init(&v->references, 1);
  return v;
}

tc_volume *tc_volume_new(const tc_volume_desc *desc, GError **error) {
  tc_volume *v = check_voxels(desc, error) ? placed(desc, error) : NULL;
  if (!v) return NULL;
  v->bytes = (size_t)desc->dims[0] * (size_t)desc->dims[1] * (size_t)desc->dims[2] * tc_voxel_size(desc->type);
  v->mapped_bytes = v->bytes + TAIL_PAD_BYTES;
  /* mmap instead of malloc: zeroed pages, allocated on first touch, and huge pages where possible. */
  void *p = mmap(NULL, v->mapped_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS | MAP_NORESERVE, -1, 0);
  if (p == MAP_FAILED) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "volume: no memory for %zu bytes of voxels", v->bytes);
    free(v);
    return NULL;
  }
  madvise(p, v->mapped_bytes, MADV_HUGEPAGE);
  v->voxels = p;
  return v;
}

void *tc_volume_voxels(tc_volume *volume) { return volume->sealed ? NULL : volume->voxels; }
const void *tc_volume_data(const tc_volume *volume) { return volume->voxels; }

static size_t voxel_count(const tc_volume *v) { return v->bytes / tc_voxel_size(v->desc.type); }

/* Range of an integer array; a plain loop that the compiler vectorises. */
#define RANGE_OF(name, type)                                                                                         \
  static void range_##name(const type *p, size_t n, double *lo, double *hi) {                                        \
    type a = p[0], b = p[0];                                                                                         \
    for (size_t i = 1; i < n; i++) {                                                                                 \
      a = p[i] < a ? p[i] : a;                                                                                       \
      b = p[i] > b ? p[i] : b;                                                                                       \
    }                                                                                                                \
    *lo = a, *hi = b;                                                                                                \
  }
RANGE_OF(u8, uint8_t)
RANGE_OF(i8, int8_t)
RANGE_OF(u16, uint16_t)
RANGE_OF(i16, int16_t)

static void range_f32(const float *p, size_t n, double *lo, double *hi, uint64_t *non_finite) {
  float a = INFINITY, b = -INFINITY;
  uint64_t bad = 0;
  for (size_t i = 0; i < n; i++) {
    if (!isfinite(p[i])) {
      bad++;
      continue;
    }
    a = fminf(a, p[i]);
    b = fmaxf(b, p[i]);
  }
  *non_finite = bad;
  *lo = bad == n ? 0 : a, *hi = bad == n ? 0 : b;
}

typedef struct sealing {
  bool (*goes_on)(void *user); /* or NULL */
  void *user;
  double lo, hi, factor;
} sealing;

/* Kernels interpolate without a test, so non-finite voxels are replaced once, here; NaN by `gap`. */
static void mend_f32(float *p, size_t n, float lo, float hi, float gap) {
  for (size_t i = 0; i < n; i++)
    if (!isfinite(p[i])) p[i] = isnan(p[i]) ? gap : p[i] > 0 ? hi : lo;
}

/* Stored voxel of a gap whose neighbours are gaps too: 0 in a signed map, where the minimum would be the strongest
 * deactivation; else the smallest value, as for HU. */
static double value_of_gap(const tc_volume *v, const sealing *s) {
  const double zero = 0 - v->desc.intercept / v->desc.slope; /* never -0 */
  return s->lo < zero && zero < s->hi && strcmp(v->desc.unit, "HU") != 0 ? zero : s->lo;
}

/* Records which voxels are NaN. If out of memory, gaps are forgotten and show their replacement. */
static void mark_gaps(tc_volume *v, size_t at, size_t n) {
  const float *p = (const float *)v->voxels;
  for (size_t i = at; i < at + n; i++) {
    if (!isnan(p[i])) continue;
    if (!v->gaps) {
      tc_volume_desc desc = v->desc;
      desc.type = TC_U8, desc.slope = 1, desc.intercept = 0;
      v->gaps = tc_volume_new(&desc, NULL);
      if (!v->gaps) return;
    }
    v->gaps->voxels[i] = 1;
  }
}

static bool is_gap(const tc_volume *v, size_t i) { return v->gaps && v->gaps->voxels[i]; }

/* The mean of the finite voxels around a gap; `otherwise` if there are none. */
static float mean_around(const tc_volume *v, size_t i, float otherwise) {
  const size_t nx = (size_t)v->desc.dims[0], ny = (size_t)v->desc.dims[1];
  const int at[3] = {(int)(i % nx), (int)(i / nx % ny), (int)(i / nx / ny)};
  double sum = 0;
  int count = 0;
  for (int around = 0; around < 27; around++) {
    const int step[3] = {around % 3 - 1, around / 3 % 3 - 1, around / 9 - 1};
    bool inside = true;
    for (int k = 0; k < 3; k++)
      if (at[k] + step[k] < 0 || at[k] + step[k] >= v->desc.dims[k]) inside = false;
    const size_t there = inside ? (size_t)((int64_t)i + step[0] + (int64_t)nx * (step[1] + (int64_t)ny * step[2])) : i;
    if (is_gap(v, there)) continue;
    sum += (double)((const float *)v->voxels)[there];
    count++;
  }
  return count ? (float)(sum / count) : otherwise;
}

static void fill_gaps(tc_volume *v, size_t at, size_t n, float otherwise) {
  float *p = (float *)v->voxels;
  for (size_t i = at; i < at + n; i++)
    if (v->gaps->voxels[i]) p[i] = mean_around(v, i, otherwise);
}

/* The power of two by which an f32 volume is scaled, because differences of voxels near the ends of float's range
 * would overflow or vanish; exact, and undone by the slope. 1: none needed. */
static double factor_f32(double lo, double hi) {
  double largest = fmax(fabs(lo), fabs(hi));
  if (largest == 0 || (largest < 1e30 && largest > 1e-30)) return 1;
  return largest >= 1e30 ? 0x1p-64 : 0x1p64;
}

static void scale_f32(float *p, size_t n, double factor) {
  for (size_t i = 0; i < n; i++) p[i] = (float)((double)p[i] * factor);
}

/* Voxels between two calls of goes_on(): a few milliseconds of work. */
#define SEAL_VOXELS ((size_t)4 << 20)

/* Range of n voxels from `at` on; *bad counts non-finite ones. */
static void range_of(const tc_volume *v, size_t at, size_t n, double *lo, double *hi, uint64_t *bad) {
  const uint8_t *p = v->voxels + at * tc_voxel_size(v->desc.type);
  *bad = 0;
  switch (v->desc.type) {
  case TC_U8: range_u8(p, n, lo, hi); break;
  case TC_I8: range_i8((const int8_t *)p, n, lo, hi); break;
  case TC_U16: range_u16((const uint16_t *)p, n, lo, hi); break;
  case TC_I16: range_i16((const int16_t *)p, n, lo, hi); break;
  case TC_F32: range_f32((const float *)p, n, lo, hi, bad); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

static bool asks(const sealing *s) { return !s->goes_on || s->goes_on(s->user); }

static bool find_range(tc_volume *v, sealing *s) {
  const size_t count = voxel_count(v);
  bool any = false;
  for (size_t at = 0; at < count; at += SEAL_VOXELS) {
    const size_t n = count - at < SEAL_VOXELS ? count - at : SEAL_VOXELS;
    double lo = 0, hi = 0;
    uint64_t bad;
    range_of(v, at, n, &lo, &hi, &bad);
    v->stats.non_finite += bad;
    if (bad < n) {
      s->lo = any ? fmin(s->lo, lo) : lo;
      s->hi = any ? fmax(s->hi, hi) : hi;
      any = true;
    }
    if (!asks(s)) return false;
  }
  return true;
}

typedef void (*mend_fn)(tc_volume *v, size_t at, size_t n, const sealing *s);

static void mend_non_finite(tc_volume *v, size_t at, size_t n, const sealing *s) {
  mark_gaps(v, at, n);
  mend_f32((float *)v->voxels + at, n, (float)s->lo, (float)s->hi, (float)value_of_gap(v, s));
}

static void mend_gaps(tc_volume *v, size_t at, size_t n, const sealing *s) {
  fill_gaps(v, at, n, (float)value_of_gap(v, s));
}

static void mend_scale(tc_volume *v, size_t at, size_t n, const sealing *s) {
  scale_f32((float *)v->voxels + at, n, s->factor);
}

static bool mend_all(tc_volume *v, mend_fn step, const sealing *s) {
  const size_t count = voxel_count(v);
  for (size_t at = 0; at < count; at += SEAL_VOXELS) {
    step(v, at, count - at < SEAL_VOXELS ? count - at : SEAL_VOXELS, s);
    if (!asks(s)) return false;
  }
  return true;
}

/* Replaces non-finite voxels, and scales if the range requires it. */
static bool mend(tc_volume *v, sealing *s) {
  s->factor = factor_f32(s->lo, s->hi);
  if (v->stats.non_finite && !mend_all(v, mend_non_finite, s)) return false;
  if (v->gaps && !mend_all(v, mend_gaps, s)) return false;
  if (v->gaps) tc_volume_seal_within(v->gaps, 0, 1);
  if (s->factor != 1 && !mend_all(v, mend_scale, s)) return false;
  v->desc.slope /= s->factor;
  s->lo *= s->factor;
  s->hi *= s->factor;
  return true;
}

static void end_seal(tc_volume *v, const sealing *s) {
  double a = v->desc.slope * s->lo + v->desc.intercept, b = v->desc.slope * s->hi + v->desc.intercept;
  v->stats.voxel_min = s->lo, v->stats.voxel_max = s->hi;
  v->stats.min = fmin(a, b), v->stats.max = fmax(a, b);
  v->sealed = true;
}

bool tc_volume_seal_while(tc_volume *volume, bool (*goes_on)(void *user), void *user) {
  if (volume->sealed) return true;
  sealing s = {.goes_on = goes_on, .user = user};
  if (!find_range(volume, &s) || (volume->desc.type == TC_F32 && !mend(volume, &s))) return false;
  end_seal(volume, &s);
  return true;
}

void tc_volume_seal_within(tc_volume *volume, double lo, double hi) {
  sealing s = {.lo = lo, .hi = hi};
  if (volume->desc.type == TC_F32) mend(volume, &s);
  end_seal(volume, &s);
}

tc_volume *tc_volume_of_sparse(const tc_volume_desc *desc, const tc_sparse *sparse, GError **error) {
  tc_volume *v = placed(desc, error);
  if (!v) return NULL;
  v->sparse = *sparse;
  v->bytes = sparse->bytes;
  end_seal(v, &(sealing){.lo = sparse->voxel_min, .hi = sparse->voxel_max});
  return v;
}

const tc_sparse *tc_volume_sparse(const tc_volume *volume) { return volume->sparse.model ? &volume->sparse : NULL; }

void tc_volume_seal(tc_volume *volume) { tc_volume_seal_while(volume, NULL, NULL); }

void tc_volume_when_freed(tc_volume *volume, void (*freed)(void *user), void *user) {
  volume->freed = freed;
  volume->freed_user = user;
}

tc_volume *tc_volume_ref(tc_volume *volume) {
  atomic_fetch_add_explicit(&volume->references, 1, memory_order_relaxed);
  return volume;
}

void tc_volume_unref(tc_volume *volume) {
  if (!volume || atomic_fetch_sub_explicit(&volume->references, 1, memory_order_acq_rel) != 1) return;
  if (volume->voxels) munmap(volume->voxels, volume->mapped_bytes);
  if (volume->sparse.model) volume->sparse.free(volume->sparse.model);
  tc_volume_unref(volume->gaps);
  tc_volume_unref(volume->colors);
  free(volume->segments);
  if (volume->freed) volume->freed(volume->freed_user);
  free(volume);
}

void tc_volume_set_provenance(tc_volume *volume, const tc_provenance *provenance) { volume->provenance = *provenance; }
const tc_provenance *tc_volume_provenance(const tc_volume *volume) { return &volume->provenance; }

static int by_label(const void *a, const void *b) {
  const uint32_t x = ((const tc_segment *)a)->label, y = ((const tc_segment *)b)->label;
  return (x > y) - (x < y);
}

void tc_volume_set_segments(tc_volume *volume, const tc_segment *segments, size_t count) {
  free(volume->segments);
  volume->segments = count ? malloc(count * sizeof *segments) : NULL;
  volume->n_segments = volume->segments ? count : 0;
  if (!volume->segments) return;
  memcpy(volume->segments, segments, count * sizeof *segments);
  qsort(volume->segments, count, sizeof *segments, by_label);
}

const tc_segment *tc_volume_segments(const tc_volume *volume, size_t *count) {
  *count = volume->n_segments;
  return volume->segments;
}

const tc_segment *tc_volume_segment(const tc_volume *volume, uint32_t label) {
  const tc_segment key = {.label = label};
  return volume->n_segments ? bsearch(&key, volume->segments, volume->n_segments, sizeof key, by_label) : NULL;
}

tc_volume *tc_volume_gaps(const tc_volume *volume) { return volume->gaps; }

void tc_volume_set_colors(tc_volume *volume, tc_volume *colors) { volume->colors = colors; }
tc_volume *tc_volume_colors(const tc_volume *volume) { return volume->colors; }

const tc_volume_desc *tc_volume_describe(const tc_volume *volume) { return &volume->desc; }
const tc_volume_stats *tc_volume_statistics(const tc_volume *volume) { return &volume->stats; }
size_t tc_volume_bytes(const tc_volume *volume) { return volume->bytes; }
uint64_t tc_volume_serial(const tc_volume *volume) { return volume->serial; }

static void multiply3(const double m[9], const double x[3], double y[3]) {
  for (int r = 0; r < 3; r++) y[r] = m[3 * r] * x[0] + m[3 * r + 1] * x[1] + m[3 * r + 2] * x[2];
}

void tc_volume_index_to_lps(const tc_volume *volume, const double index[3], double lps[3]) {
  double y[3];
  multiply3(volume->to_lps, index, y);
  for (int k = 0; k < 3; k++) lps[k] = y[k] + volume->desc.origin[k];
}

void tc_volume_lps_to_index(const tc_volume *volume, const double lps[3], double index[3]) {
  double d[3];
  for (int k = 0; k < 3; k++) d[k] = lps[k] - volume->desc.origin[k];
  multiply3(volume->to_index, d, index);
}

void tc_volume_lps_to_index_matrix(const tc_volume *volume, double matrix[9]) {
  memcpy(matrix, volume->to_index, sizeof volume->to_index);
}

void tc_volume_index_box(const tc_volume *volume, double lo[3], double hi[3]) {
  for (int k = 0; k < 3; k++) {
    int n = volume->desc.dims[k];
    lo[k] = n == 1 ? -0.5 : 0;
    hi[k] = n == 1 ? 0.5 : n - 1;
  }
}

static size_t place_of(const tc_volume *v, const int at[3]) {
  return ((size_t)at[2] * (size_t)v->desc.dims[1] + (size_t)at[1]) * (size_t)v->desc.dims[0] + (size_t)at[0];
}

void tc_volume_fetch(const tc_volume *v, const int at[3]) {
  if (v->voxels) __builtin_prefetch((const char *)v->voxels + place_of(v, at) * tc_voxel_size(v->desc.type));
}

bool tc_volume_voxel(const tc_volume *v, const int at[3], double *voxel) {
  for (int k = 0; k < 3; k++)
    if (at[k] < 0 || at[k] >= v->desc.dims[k]) return false;
  if (v->sparse.model) return v->sparse.voxel(v->sparse.model, at, voxel);
  const size_t i = place_of(v, at);
  *voxel = tc_voxel_at(v->desc.type, v->voxels, i);
  return !is_gap(v, i);
}

static bool value_of_nearest(const tc_volume *v, const double index[3], double *value) {
  int at[3];
  for (int k = 0; k < 3; k++) {
    if (!(fabs(index[k]) <= INT32_MAX)) return false;
    at[k] = (int)lround(index[k]);
  }
  if (!tc_volume_voxel(v, at, value)) return false;
  *value = v->desc.slope * *value + v->desc.intercept;
  return true;
}

/* Positions this close to the box count as inside: they arrive as rounded decimals, which must not exclude the first
 * and last planes. */
#define BOX_SLACK 1e-3

bool tc_volume_value_at(const tc_volume *volume, const double index[3], double *value) {
  double lo[3], hi[3], f[3];
  size_t low[3], high[3];
  if (volume->sparse.model) return value_of_nearest(volume, index, value);
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) {
    if (!(index[k] >= lo[k] - BOX_SLACK && index[k] <= hi[k] + BOX_SLACK)) return false;
    int n = volume->desc.dims[k];
    double p = n == 1 ? 0 : fmin(fmax(index[k], lo[k]), hi[k]);
    int i = (int)p;
    if (i > n - 2) i = n - 2 < 0 ? 0 : n - 2;
    f[k] = p - i;
    low[k] = (size_t)i;
    high[k] = (size_t)(i + 1 < n ? i + 1 : i);
  }
  size_t nx = (size_t)volume->desc.dims[0], ny = (size_t)volume->desc.dims[1];
  double sum = 0;
  for (int corner = 0; corner < 8; corner++) {
    size_t x = corner & 1 ? high[0] : low[0], y = corner & 2 ? high[1] : low[1], z = corner & 4 ? high[2] : low[2];
    double w = (corner & 1 ? f[0] : 1 - f[0]) * (corner & 2 ? f[1] : 1 - f[1]) * (corner & 4 ? f[2] : 1 - f[2]);
    const size_t at = (z * ny + y) * nx + x;
    if (w > 0 && is_gap(volume, at)) return false;
    sum += w * tc_voxel_at(volume->desc.type, volume->voxels, at);
  }
  *value = volume->desc.slope * sum + volume->desc.intercept;
  return true;
}
