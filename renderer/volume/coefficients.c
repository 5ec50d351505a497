#include "renderer/volume/coefficients.h"

#include <math.h>
#include <string.h>

#define POLE (-0.26794919243112270647) /* sqrt(3) - 2 */
#define HORIZON 44                     /* |POLE|^44 is below double's last bit */
#define COLUMNS 64                     /* filtered side by side */

uint64_t tc_coefficients_bytes(const tc_volume *volume) {
  const int *n = tc_volume_describe(volume)->dims;
  return (uint64_t)n[0] * (uint64_t)n[1] * (uint64_t)n[2] * sizeof(float);
}

/* Solves for `width` <= COLUMNS neighbouring columns of n samples, `stride` floats apart: a causal filter down, its
 * mirror up. What lies before the first sample is the column mirrored, over and over, each end sample twice. */
static void filter_columns(float *p, int n, ptrdiff_t stride, int width) {
  double sum[COLUMNS] = {0}, weight = 1, z = POLE;
  int reach = 2 * n < HORIZON ? 2 * n : HORIZON;
  for (int k = 1; k <= reach; k++) {
    const float *row = p + (k <= n ? k - 1 : 2 * n - k) * stride;
    weight *= z;
    for (int x = 0; x < width; x++) sum[x] += weight * (double)row[x];
  }
  double period = reach == 2 * n ? 1 - weight : 1; /* the sum over one period stands for all of them */
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

typedef struct coefficients_job {
  const tc_volume *from;
  float *to;
  const int *dims;
  float base; /* taken off before and put back after, so that a constant stays exactly that */
} coefficients_job;

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

/* One slice: from voxels, then along x and y. */
static void slice_task(void *context, int z, int worker) {
  const coefficients_job *job = context;
  int nx = job->dims[0], ny = job->dims[1];
  size_t count = (size_t)nx * (size_t)ny;
  float *slice = job->to + (size_t)z * count;
  load(job->from, (size_t)z * count, count, slice);
  for (size_t i = 0; i < count; i++) slice[i] -= job->base;
  for (int y = 0; y < ny; y++) filter(slice + (ptrdiff_t)y * nx, nx, 1, 1);
  filter(slice, ny, nx, nx);
}

/* One row of every slice: along z. */
static void row_task(void *context, int y, int worker) {
  const coefficients_job *job = context;
  int nx = job->dims[0], nz = job->dims[2];
  ptrdiff_t stride = (ptrdiff_t)nx * job->dims[1];
  float *row = job->to + (ptrdiff_t)y * nx;
  filter(row, nz, stride, nx);
  for (int z = 0; z < nz; z++)
    for (int x = 0; x < nx; x++) row[z * stride + x] += job->base;
}

tc_volume *tc_coefficients_make(const tc_volume *volume, tc_pool *pool, GError **error) {
  tc_volume_desc desc = *tc_volume_describe(volume);
  desc.type = TC_F32;
  tc_volume *to = tc_volume_new(&desc, error);
  if (!to) return NULL;
  coefficients_job job = {.from = volume, .to = tc_volume_voxels(to), .dims = desc.dims};
  load(volume, 0, 1, &job.base);
  tc_pool_run(pool, desc.dims[2], slice_task, &job);
  tc_pool_run(pool, desc.dims[1], row_task, &job);
  tc_volume_seal(to);
  return to;
}
