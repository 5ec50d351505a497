#include "renderer/volume/body.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Around what is left out voxels are mixtures of it and air: they go too. */
#define HALO 2
/* A shell is this much thinner than the body, or has so few voxels. */
#define THIN 0.2
#define THIN_VOXELS 3.5
/* Of a part's voxels, at least, outside of the body. */
#define OUTSIDE 0.6
/* Runs and parts are told apart only where voxels are this many times as many. */
#define VOXELS_PER_RUN 12
#define VOXELS_PER_PART 64
#define FEW 4096

typedef struct run { int32_t from, end; uint32_t parent; } run; /* voxels from..end-1 of a row; once numbered: its part */

typedef struct part {
  uint64_t voxels, outside, inner; /* inner: pairs of neighbours along y and z */
  uint32_t runs;
  bool hidden;
} part;

typedef struct parts {
  const tc_volume *volume;
  const tc_body_options *options;
  int nx, ny, nz;
  double from, to;     /* dense voxels, as stored */
  bool padded;         /* there are values above the options' most */
  run *runs;
  uint32_t *rows;      /* [nz * ny + 1]: a row's first run */
  size_t count, capacity, most;
  part *part;
  uint32_t n_parts, body;
  int32_t *across;     /* [2][nx]: first and last row of the body in each column of a slice */
  uint8_t *near;       /* [nz * ny]: the row has hidden runs */
  uint8_t *mask;       /* [nx] */
  int low[3], high[3]; /* voxels that are kept, inclusive */
} parts;

static bool goes_on(const parts *p) { return !p->options->goes_on || p->options->goes_on(p->options->user); }

/* ---- what is dense ---- */

#define DENSE_OF(name, type)                                                                                         \
  static void dense_##name(const type *v, int n, float from, float to, uint8_t *mask) {                              \
    for (int i = 0; i < n; i++) mask[i] = (float)v[i] >= from && (float)v[i] <= to;                                  \
  }
DENSE_OF(u8, uint8_t)
DENSE_OF(i8, int8_t)
DENSE_OF(u16, uint16_t)
DENSE_OF(i16, int16_t)
DENSE_OF(f32, float)

static const uint8_t *row_of(const tc_volume *v, size_t row) {
  const tc_volume_desc *d = tc_volume_describe(v);
  return (const uint8_t *)tc_volume_data(v) + row * (size_t)d->dims[0] * tc_voxel_size(d->type);
}

static void mark(parts *p, size_t row, double from, double to) {
  const uint8_t *v = row_of(p->volume, row);
  const float a = (float)from, b = (float)to;
  switch (tc_volume_describe(p->volume)->type) {
  case TC_U8: dense_u8(v, p->nx, a, b, p->mask); break;
  case TC_I8: dense_i8((const int8_t *)v, p->nx, a, b, p->mask); break;
  case TC_U16: dense_u16((const uint16_t *)v, p->nx, a, b, p->mask); break;
  case TC_I16: dense_i16((const int16_t *)v, p->nx, a, b, p->mask); break;
  case TC_F32: dense_f32((const float *)v, p->nx, a, b, p->mask); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

/* ---- runs, joined ---- */

static uint32_t root_of(parts *p, uint32_t i) {
  while (p->runs[i].parent != i) i = p->runs[i].parent = p->runs[p->runs[i].parent].parent;
  return i;
}

static void join(parts *p, uint32_t a, uint32_t b) {
  a = root_of(p, a), b = root_of(p, b);
  if (a < b) p->runs[b].parent = a;
  else p->runs[a].parent = b;
}

static bool add_run(parts *p, int from, int end) {
  if (p->count == p->capacity) {
    size_t capacity = p->capacity ? 2 * p->capacity : FEW;
    run *grown = p->count < p->most ? realloc(p->runs, capacity * sizeof *grown) : NULL;
    if (!grown) return false;
    p->runs = grown;
    p->capacity = capacity;
  }
  p->runs[p->count] = (run){from, end, (uint32_t)p->count};
  p->count++;
  return true;
}

static bool add_row(parts *p, size_t row) {
  mark(p, row, p->from, p->to);
  p->rows[row] = (uint32_t)p->count;
  const uint8_t *at = p->mask, *end = p->mask + p->nx;
  while (at < end && (at = memchr(at, 1, (size_t)(end - at)))) {
    const uint8_t *after = memchr(at, 0, (size_t)(end - at));
    if (!after) after = end;
    if (!add_run(p, (int)(at - p->mask), (int)(after - p->mask))) return false;
    at = after;
  }
  p->rows[row + 1] = (uint32_t)p->count;
  return true;
}

/* Joins the runs of two rows that touch (`joins`), or counts the voxels that do for each run's part. */
static void meet(parts *p, size_t row, size_t other, bool joins) {
  uint32_t i = p->rows[row], j = p->rows[other];
  while (i < p->rows[row + 1] && j < p->rows[other + 1]) {
    const run *a = &p->runs[i], *b = &p->runs[j];
    const int from = a->from > b->from ? a->from : b->from, end = a->end < b->end ? a->end : b->end;
    const bool first_ends = a->end < b->end;
    if (from < end && joins) join(p, i, j);
    if (from < end && !joins) p->part[a->parent].inner += (uint64_t)(end - from);
    if (first_ends) i++;
    else j++;
  }
}

static void meet_before(parts *p, int y, int z, bool joins) {
  const size_t row = (size_t)z * (size_t)p->ny + (size_t)y;
  if (y > 0) meet(p, row, row - 1, joins);
  if (z > 0) meet(p, row, row - (size_t)p->ny, joins);
}

static bool find_runs(parts *p) {
  for (int z = 0; z < p->nz; z++) {
    if (!goes_on(p)) return false;
    for (int y = 0; y < p->ny; y++) {
      if (!add_row(p, (size_t)z * (size_t)p->ny + (size_t)y)) return false;
      meet_before(p, y, z, true);
    }
  }
  return p->count > 0;
}

/* ---- parts ---- */

/* A run's parent is never after it: parents are numbered before their children look. */
static bool number_parts(parts *p) {
  size_t most = p->most * VOXELS_PER_RUN / VOXELS_PER_PART + FEW;
  for (size_t i = 0; i < p->count; i++) p->n_parts += p->runs[i].parent == i;
  p->part = p->n_parts <= most ? calloc(p->n_parts, sizeof *p->part) : NULL;
  if (!p->part) return false;
  uint32_t next = 0;
  for (size_t i = 0; i < p->count; i++) {
    run *r = &p->runs[i];
    r->parent = r->parent == i ? next++ : p->runs[r->parent].parent;
    p->part[r->parent].runs++;
    p->part[r->parent].voxels += (uint64_t)(r->end - r->from);
  }
  for (uint32_t i = 1; i < p->n_parts; i++)
    if (p->part[i].voxels > p->part[p->body].voxels) p->body = i;
  return true;
}

/* First and last voxel of the body in a row; false: it is not there. */
static bool body_in_row(const parts *p, size_t row, int *first, int *last) {
  bool found = false;
  for (uint32_t i = p->rows[row]; i < p->rows[row + 1]; i++) {
    if (p->runs[i].parent != p->body) continue;
    if (!found) *first = p->runs[i].from;
    *last = p->runs[i].end - 1;
    found = true;
  }
  return found;
}

static void find_columns(parts *p, int z) {
  int32_t *first = p->across, *last = p->across + p->nx;
  for (int x = 0; x < p->nx; x++) first[x] = p->ny, last[x] = -1;
  for (int y = 0; y < p->ny; y++) {
    const size_t row = (size_t)z * (size_t)p->ny + (size_t)y;
    for (uint32_t i = p->rows[row]; i < p->rows[row + 1]; i++) {
      if (p->runs[i].parent != p->body) continue;
      for (int x = p->runs[i].from; x < p->runs[i].end; x++) {
        if (first[x] > y) first[x] = y;
        last[x] = y;
      }
    }
  }
}

static void count_outside(parts *p, int y, int z) {
  const size_t row = (size_t)z * (size_t)p->ny + (size_t)y;
  int first = p->nx, last = -1;
  body_in_row(p, row, &first, &last);
  for (uint32_t i = p->rows[row]; i < p->rows[row + 1]; i++) {
    const run *r = &p->runs[i];
    for (int x = r->from; x < r->end && r->parent != p->body; x++)
      p->part[r->parent].outside += x < first || x > last || y < p->across[x] || y > p->across[p->nx + x];
  }
}

/* Twice the voxels by the faces: of a sheet its thickness. */
static double thickness(const part *a) {
  return 2 * (double)a->voxels / (2 * (double)a->runs + 4 * (double)a->voxels - 2 * (double)a->inner);
}

static bool choose_parts(parts *p) {
  for (int z = 0; z < p->nz; z++) {
    if (!goes_on(p)) return false;
    find_columns(p, z);
    for (int y = 0; y < p->ny; y++) {
      meet_before(p, y, z, false);
      count_outside(p, y, z);
    }
  }
  const double thin = fmax(THIN_VOXELS, THIN * thickness(&p->part[p->body]));
  for (uint32_t i = 0; i < p->n_parts; i++) {
    part *a = &p->part[i];
    a->hidden = i != p->body && (double)a->outside >= OUTSIDE * (double)a->voxels && thickness(a) < thin;
  }
  return true;
}

/* ---- the volume that is left ---- */

/* Notes what is hidden where, and the box of what is dense and not. Returns the voxels hidden. */
static uint64_t find_box(parts *p) {
  uint64_t hidden = 0;
  for (int k = 0; k < 3; k++) p->low[k] = INT32_MAX, p->high[k] = -1;
  for (size_t row = 0; row < (size_t)p->ny * (size_t)p->nz; row++)
    for (uint32_t i = p->rows[row]; i < p->rows[row + 1]; i++) {
      const run *r = &p->runs[i];
      const int at[3] = {r->from, (int)(row % (size_t)p->ny), (int)(row / (size_t)p->ny)};
      const int end[3] = {r->end - 1, at[1], at[2]};
      if (p->part[r->parent].hidden) p->near[row] = 1, hidden += (uint64_t)(r->end - r->from);
      for (int k = 0; k < 3 && !p->part[r->parent].hidden; k++) {
        if (at[k] < p->low[k]) p->low[k] = at[k];
        if (end[k] > p->high[k]) p->high[k] = end[k];
      }
    }
  return hidden;
}

static void whole_box(parts *p) {
  const int n[3] = {p->nx, p->ny, p->nz};
  for (int k = 0; k < 3; k++) p->low[k] = 0, p->high[k] = n[k] - 1;
}

static void widen_box(parts *p) {
  const int n[3] = {p->nx, p->ny, p->nz};
  for (int k = 0; k < 3; k++) {
    p->low[k] = p->low[k] > HALO ? p->low[k] - HALO : 0;
    p->high[k] = p->high[k] + HALO < n[k] ? p->high[k] + HALO : n[k] - 1;
  }
}

static void mark_runs(parts *p, size_t row, bool hidden, int halo) {
  for (uint32_t i = p->rows[row]; i < p->rows[row + 1]; i++) {
    const run *r = &p->runs[i];
    if (p->part[r->parent].hidden != hidden) continue;
    const int from = r->from > halo ? r->from - halo : 0, end = r->end + halo < p->nx ? r->end + halo : p->nx;
    memset(p->mask + from, hidden, (size_t)(end - from));
  }
}

/* Marks what of a row goes: padding, what is hidden and its halo, but nothing dense that stays. */
static void mark_row(parts *p, int y, int z) {
  const size_t row = (size_t)z * (size_t)p->ny + (size_t)y;
  const tc_volume_desc *d = tc_volume_describe(p->volume);
  const double past = (p->options->most - d->intercept) / d->slope;
  if (!p->padded) memset(p->mask, 0, (size_t)p->nx);
  else if (d->slope > 0) mark(p, row, nextafterf((float)past, INFINITY), INFINITY);
  else mark(p, row, -INFINITY, nextafterf((float)past, -INFINITY));
  if (!p->near) return;
  for (int dz = -HALO; dz <= HALO; dz++)
    for (int dy = -HALO; dy <= HALO; dy++) {
      const int a = y + dy, b = z + dz;
      const size_t other = (size_t)b * (size_t)p->ny + (size_t)a;
      if (a >= 0 && b >= 0 && a < p->ny && b < p->nz && p->near[other]) mark_runs(p, other, true, HALO);
    }
  mark_runs(p, row, false, 0);
}

static tc_volume *new_volume(const parts *p) {
  tc_volume_desc d = *tc_volume_describe(p->volume);
  const double low[3] = {p->low[0], p->low[1], p->low[2]};
  uint64_t bytes = tc_voxel_size(d.type);
  tc_volume_index_to_lps(p->volume, low, d.origin);
  for (int k = 0; k < 3; k++) {
    d.dims[k] = p->high[k] - p->low[k] + 1;
    bytes *= (uint64_t)d.dims[k];
  }
  if (p->options->reserve && !p->options->reserve(p->options->user, bytes)) return NULL;
  return tc_volume_new(&d, NULL);
}

/* The air as a voxel, within what voxels there are. */
static double air_voxel(const parts *p) {
  const tc_volume_desc *d = tc_volume_describe(p->volume);
  const tc_volume_stats *s = tc_volume_statistics(p->volume);
  return fmin(fmax((p->options->air - d->intercept) / d->slope, s->voxel_min), s->voxel_max);
}

static void put(uint8_t *row, tc_voxel_type type, int x, double voxel) {
  switch (type) {
  case TC_U8: row[x] = (uint8_t)voxel; break;
  case TC_I8: ((int8_t *)row)[x] = (int8_t)voxel; break;
  case TC_U16: ((uint16_t *)row)[x] = (uint16_t)voxel; break;
  case TC_I16: ((int16_t *)row)[x] = (int16_t)voxel; break;
  case TC_F32: ((float *)row)[x] = (float)voxel; break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

static bool fill(parts *p, tc_volume *made) {
  const tc_volume_desc *d = tc_volume_describe(made);
  const size_t size = tc_voxel_size(d->type), width = (size_t)d->dims[0] * size;
  const double air = air_voxel(p);
  uint8_t *to = tc_volume_voxels(made);
  for (int z = p->low[2]; z <= p->high[2]; z++) {
    if (!goes_on(p)) return false;
    for (int y = p->low[1]; y <= p->high[1]; y++, to += width) {
      memcpy(to, row_of(p->volume, (size_t)z * (size_t)p->ny + (size_t)y) + (size_t)p->low[0] * size, width);
      mark_row(p, y, z);
      const uint8_t *mask = p->mask + p->low[0], *end = mask + d->dims[0];
      for (const uint8_t *at = mask; at < end && (at = memchr(at, 1, (size_t)(end - at))); at++)
        put(to, d->type, (int)(at - mask), air);
    }
  }
  return true;
}

static bool find_parts(parts *p) {
  const size_t rows = (size_t)p->ny * (size_t)p->nz;
  p->rows = calloc(rows + 1, sizeof *p->rows);
  p->across = malloc(2 * (size_t)p->nx * sizeof *p->across);
  p->near = calloc(rows, 1);
  p->most = rows * (size_t)p->nx / VOXELS_PER_RUN + FEW;
  return p->rows && p->across && p->near && find_runs(p) && number_parts(p) && choose_parts(p) && find_box(p) > 0;
}

static void forget_parts(parts *p) {
  free(p->runs);
  free(p->rows);
  free(p->part);
  free(p->across);
  free(p->near);
  p->near = NULL;
  p->runs = NULL, p->rows = NULL, p->part = NULL, p->across = NULL;
}

tc_volume *tc_body_of(const tc_volume *volume, const tc_body_options *options) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  const double a = (options->dense - d->intercept) / d->slope, b = (options->most - d->intercept) / d->slope;
  parts p = {.volume = volume, .options = options, .nx = d->dims[0], .ny = d->dims[1], .nz = d->dims[2],
             .from = fmin(a, b), .to = fmax(a, b), .padded = s->max > options->most, .mask = malloc((size_t)d->dims[0])};
  tc_volume *made = NULL;
  const bool found = p.mask && options->parts && find_parts(&p);
  if (found) {
    widen_box(&p);
  } else {
    forget_parts(&p);
    whole_box(&p);
  }
  if (p.mask && (found || p.padded)) made = new_volume(&p);
  if (made && fill(&p, made)) {
    tc_volume_seal_within(made, s->voxel_min, s->voxel_max);
  } else {
    tc_volume_unref(made);
    made = NULL;
  }
  forget_parts(&p);
  free(p.mask);
  return made;
}
