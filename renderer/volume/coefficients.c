#include "renderer/volume/coefficients.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#define POLE (-0.26794919243112270647) /* sqrt(3) - 2 */
#define HORIZON 44                     /* samples after which |POLE|^n is below the last bit of a double */
#define COLUMNS 64                     /* columns filtered together */

uint64_t tc_coefficients_bytes(const tc_volume *volume) {
  const int *n = tc_volume_describe(volume)->dims;
  return (uint64_t)n[0] * (uint64_t)n[1] * (uint64_t)n[2] * sizeof(float);
}

/* Filters `width` <= COLUMNS neighbouring columns of n samples, `stride` floats apart: a causal filter downwards, then
 * the anticausal one upwards. Boundary: half-sample symmetric (mirrored with end samples repeated), hence periodic. */
static void filter_columns(float *p, int n, ptrdiff_t stride, int width) {
  double sum[COLUMNS] = {0}, weight = 1, z = POLE;
  int reach = 2 * n < HORIZON ? 2 * n : HORIZON;
  for (int k = 1; k <= reach; k++) {
    const float *row = p + (k <= n ? k - 1 : 2 * n - k) * stride;
    weight *= z;
    for (int x = 0; x < width; x++) sum[x] += weight * (double)row[x];
  }
  double period = reach == 2 * n ? 1 - weight : 1; /* sums the geometric series over all periods */
  for (int x = 0; x < width; x++) p[x] = (float)((double)p[x] + sum[x] / period);
  for (int i = 1; i < n; i++) {
    float *row = p + i * stride, *before = row - stride;
    for (int x = 0; x < width; x++) row[x] += (float)z * before[x];
  }
  float *last = p + (n - 1) * stride;
  for (int x = 0; x < width; x++) last[x] *= (float)(6 * z / (z - 1));
  for (int i = n - 2; i >= 0; i--) {
    float *row = p + i * stride, *after = row + stride;
    for (int x = 0; x < width; x++) row[x] = (float)z * (after[x] - 6 * row[x]);
  }
}

static void filter(float *p, int n, ptrdiff_t stride, int width) {
  for (int x = 0; x < width; x += COLUMNS) filter_columns(p + x, n, stride, width - x < COLUMNS ? width - x : COLUMNS);
}

#define PIECE 65536 /* voxels per task, roughly: a fraction of a millisecond */

typedef enum pass { ALONG_X, ALONG_Y, ALONG_Z, PASSES } pass;

struct tc_coefficients {
  tc_volume *to;
  const tc_volume *from; /* during a call */
  float *voxels;
  int dims[3];
  float base; /* subtracted before filtering and added afterwards, so that a constant volume stays exactly constant */
  int pass, next; /* current pass, and its next task */
  int strips[PASSES], width[PASSES]; /* per pass: tasks per slice, or per row of slices; rows or columns per task */
  pthread_mutex_t lock; /* guards the range */
  float lo, hi;
};

static void load(const tc_volume *volume, size_t first, size_t count, float *to) {
  const void *p = tc_volume_data(volume);
  switch (tc_volume_describe(volume)->type) {
#define LOAD(type) for (size_t i = 0; i < count; i++) to[i] = (float)((const type *)p)[first + i]
  case TC_U8: LOAD(uint8_t); break;
  case TC_I8: LOAD(int8_t); break;
  case TC_U16: LOAD(uint16_t); break;
  case TC_I16: LOAD(int16_t); break;
  case TC_F32: LOAD(float); break;
  case TC_VOXEL_TYPE_COUNT: break;
#undef LOAD
  }
}

static int least(int a, int b) { return a < b ? a : b; }

/* Rows of a slice: from voxels, then along x. */
static void x_task(void *context, int index, int worker) {
  const tc_coefficients *c = context;
  int nx = c->dims[0], y = index % c->strips[ALONG_X] * c->width[ALONG_X], z = index / c->strips[ALONG_X];
  int end = least(y + c->width[ALONG_X], c->dims[1]);
  size_t first = ((size_t)z * (size_t)c->dims[1] + (size_t)y) * (size_t)nx, count = (size_t)(end - y) * (size_t)nx;
  load(c->from, first, count, c->voxels + first);
  for (size_t i = first; i < first + count; i++) c->voxels[i] -= c->base;
  for (; y < end; y++, first += (size_t)nx) filter(c->voxels + first, nx, 1, 1);
}

/* Columns of a slice: along y. */
static void y_task(void *context, int index, int worker) {
  const tc_coefficients *c = context;
  int nx = c->dims[0], x = index % c->strips[ALONG_Y] * c->width[ALONG_Y], z = index / c->strips[ALONG_Y];
  float *slice = c->voxels + (size_t)z * (size_t)nx * (size_t)c->dims[1];
  filter(slice + x, c->dims[1], nx, least(c->width[ALONG_Y], nx - x));
}

/* Part of one row of every slice: along z, and the range of the result. */
static void z_task(void *context, int index, int worker) {
  tc_coefficients *c = context;
  int nx = c->dims[0], x = index % c->strips[ALONG_Z] * c->width[ALONG_Z], y = index / c->strips[ALONG_Z];
  int width = least(c->width[ALONG_Z], nx - x);
  ptrdiff_t stride = (ptrdiff_t)nx * c->dims[1];
  float *row = c->voxels + (ptrdiff_t)y * nx + x, lo = INFINITY, hi = -INFINITY;
  filter(row, c->dims[2], stride, width);
  for (int z = 0; z < c->dims[2]; z++)
    for (int i = 0; i < width; i++) {
      float *p = row + z * stride + i;
      *p += c->base;
      lo = *p < lo ? *p : lo;
      hi = *p > hi ? *p : hi;
    }
  pthread_mutex_lock(&c->lock);
  c->lo = fminf(c->lo, lo), c->hi = fmaxf(c->hi, hi);
  pthread_mutex_unlock(&c->lock);
}

/* Whole blocks of columns that are filtered side by side. */
static int columns_for(int length, int nx) {
  int64_t blocks = PIECE / COLUMNS / length;
  return blocks * COLUMNS < nx ? (int)(blocks < 1 ? COLUMNS : blocks * COLUMNS) : nx;
}

static void choose_tasks(tc_coefficients *c) {
  const int *n = c->dims;
  int rows = PIECE / n[0] < 1 ? 1 : least(PIECE / n[0], n[1]);
  const int width[PASSES] = {rows, columns_for(n[1], n[0]), columns_for(n[2], n[0])};
  const int across[PASSES] = {n[1], n[0], n[0]};
  for (int p = 0; p < PASSES; p++) {
    c->width[p] = width[p];
    c->strips[p] = (across[p] + width[p] - 1) / width[p];
  }
}

tc_coefficients *tc_coefficients_begin(const tc_volume *volume, GError **error) {
  tc_volume_desc desc = *tc_volume_describe(volume);
  desc.type = TC_F32;
  tc_volume *to = tc_volume_new(&desc, error);
  if (!to) return NULL;
  tc_coefficients *c = calloc(1, sizeof *c);
  if (!c) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "coefficients: out of memory");
    tc_volume_unref(to);
    return NULL;
  }
  *c = (tc_coefficients){.to = to, .voxels = tc_volume_voxels(to), .lo = INFINITY, .hi = -INFINITY};
  pthread_mutex_init(&c->lock, NULL);
  memcpy(c->dims, desc.dims, sizeof c->dims);
  load(volume, 0, 1, &c->base);
  choose_tasks(c);
  return c;
}

bool tc_coefficients_go_on(tc_coefficients *c, const tc_volume *volume, tc_pool *pool) {
  static void (*const tasks[PASSES])(void *, int, int) = {x_task, y_task, z_task};
  c->from = volume;
  for (; c->pass < PASSES; c->pass++, c->next = 0) {
    int count = c->strips[c->pass] * c->dims[c->pass == ALONG_Z ? 1 : 2]; /* each task has at least a voxel */
    if (!tc_pool_go_on(pool, &c->next, count, tasks[c->pass], c)) return false;
  }
  tc_volume_seal_within(c->to, (double)c->lo, (double)c->hi);
  return true;
}

int64_t tc_coefficients_steps(const tc_coefficients *c) { return ((int64_t)c->pass << 32) + c->next; }

uint64_t tc_coefficients_held(const tc_coefficients *c) { return tc_volume_bytes(c->to); }

tc_volume *tc_coefficients_take(tc_coefficients *c) {
  tc_volume *made = tc_volume_ref(c->to);
  tc_coefficients_free(c);
  return made;
}

void tc_coefficients_free(tc_coefficients *c) {
  if (!c) return;
  tc_volume_unref(c->to);
  pthread_mutex_destroy(&c->lock);
  free(c);
}

tc_volume *tc_coefficients_make(const tc_volume *volume, tc_pool *pool, GError **error) {
  tc_coefficients *c = tc_coefficients_begin(volume, error);
  if (!c) return NULL;
  if (tc_coefficients_go_on(c, volume, pool)) return tc_coefficients_take(c);
  tc_halt_say(tc_pool_halt(pool), error);
  tc_coefficients_free(c);
  return NULL;
}
