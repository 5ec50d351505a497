#include <stdlib.h>

#include "renderer/skip/skip.h"
#include "renderer/base/clock.h"
#include "renderer/volume/voxel.h"

typedef struct minmax_job {
  const tc_volume *volume;
  tc_minmax *m;
  const int *dims;
  size_t voxel_bytes;
  void *rows; /* per worker: a row of minima and a row of maxima */
} minmax_job;

/* First and last voxel, inclusive, of a block along one axis. */
static int first_voxel(const tc_minmax *m, int index) {
  int first = index * m->block - m->reach;
  return first > 0 ? first : 0;
}

static int last_voxel(const tc_minmax *m, int index, int n) {
  int last = (index + 1) * m->block + m->reach;
  return last < n - 1 ? last : n - 1;
}

/* One row of blocks: first minima and maxima over the block's rows, voxel by voxel along x (contiguous, so the
 * compiler vectorises them), then over each block's stretch of the resulting row. */
#define ROW_OF_BLOCKS(name, type)                                                                                    \
  static void row_##name(const minmax_job *job, int by, int bz, type *lo, type *hi) {                                \
    const type *voxels = tc_volume_data(job->volume);                                                                \
    const tc_minmax *m = job->m;                                                                                     \
    int nx = job->dims[0], y0 = first_voxel(m, by), y1 = last_voxel(m, by, job->dims[1]);                           \
    int z0 = first_voxel(m, bz), z1 = last_voxel(m, bz, job->dims[2]);                                              \
    for (int z = z0; z <= z1; z++)                                                                                   \
      for (int y = y0; y <= y1; y++) {                                                                               \
        const type *p = voxels + ((size_t)z * (size_t)job->dims[1] + (size_t)y) * (size_t)nx;                        \
        if (z == z0 && y == y0)                                                                                      \
          for (int x = 0; x < nx; x++) lo[x] = hi[x] = p[x];                                                         \
        else                                                                                                         \
          for (int x = 0; x < nx; x++) {                                                                             \
            lo[x] = p[x] < lo[x] ? p[x] : lo[x];                                                                     \
            hi[x] = p[x] > hi[x] ? p[x] : hi[x];                                                                     \
          }                                                                                                          \
      }                                                                                                              \
    type *pair = (type *)m->pairs + 2 * ((size_t)bz * (size_t)m->blocks[1] + (size_t)by) * (size_t)m->blocks[0];     \
    for (int bx = 0; bx < m->blocks[0]; bx++, pair += 2) {                                                           \
      int x0 = first_voxel(m, bx), x1 = last_voxel(m, bx, nx);                                                       \
      type a = lo[x0], b = hi[x0];                                                                                   \
      for (int x = x0 + 1; x <= x1; x++) {                                                                           \
        a = lo[x] < a ? lo[x] : a;                                                                                   \
        b = hi[x] > b ? hi[x] : b;                                                                                   \
      }                                                                                                              \
      pair[0] = a, pair[1] = b;                                                                                      \
    }                                                                                                                \
  }
ROW_OF_BLOCKS(u8, uint8_t)
ROW_OF_BLOCKS(i8, int8_t)
ROW_OF_BLOCKS(u16, uint16_t)
ROW_OF_BLOCKS(i16, int16_t)
ROW_OF_BLOCKS(f32, float)

static void minmax_task(void *context, int index, int worker) {
  minmax_job *job = context;
  int by = index % job->m->blocks[1], bz = index / job->m->blocks[1];
  char *lo = (char *)job->rows + (size_t)worker * 2 * (size_t)job->dims[0] * job->voxel_bytes;
  void *hi = lo + (size_t)job->dims[0] * job->voxel_bytes;
  switch (job->m->type) {
  case TC_U8: row_u8(job, by, bz, (uint8_t *)lo, hi); break;
  case TC_I8: row_i8(job, by, bz, (int8_t *)lo, hi); break;
  case TC_U16: row_u16(job, by, bz, (uint16_t *)(void *)lo, hi); break;
  case TC_I16: row_i16(job, by, bz, (int16_t *)(void *)lo, hi); break;
  case TC_F32: row_f32(job, by, bz, (float *)(void *)lo, hi); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

tc_minmax *tc_minmax_begin(const tc_volume *volume, int block, int reach, GError **error) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  tc_minmax *m = calloc(1, sizeof *m);
  if (m) {
    *m = (tc_minmax){.block = block, .reach = reach, .type = d->type};
    size_t count = 1;
    for (int k = 0; k < 3; k++) {
      int cells = d->dims[k] > 1 ? d->dims[k] - 1 : 1;
      m->blocks[k] = (cells + block - 1) / block;
      count *= (size_t)m->blocks[k];
    }
    m->bytes = count * 2 * tc_voxel_size(d->type);
    m->pairs = malloc(m->bytes);
    if (m->pairs) return m;
  }
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "min-max blocks: out of memory");
  tc_minmax_free(m);
  return NULL;
}

bool tc_minmax_go_on(tc_minmax *m, const tc_volume *volume, tc_pool *pool, GError **error) {
  double start = tc_now_ms();
  const tc_volume_desc *d = tc_volume_describe(volume);
  minmax_job job = {.volume = volume, .m = m, .dims = d->dims, .voxel_bytes = tc_voxel_size(d->type)};
  if (m->done == m->blocks[1] * m->blocks[2]) return true;
  job.rows = malloc((size_t)tc_pool_threads(pool) * 2 * (size_t)d->dims[0] * job.voxel_bytes);
  if (!job.rows) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "min-max blocks: out of memory");
    return false;
  }
  bool made = tc_pool_go_on(pool, &m->done, m->blocks[1] * m->blocks[2], minmax_task, &job);
  free(job.rows);
  m->build_ms += tc_now_ms() - start;
  return made || tc_halt_say(tc_pool_halt(pool), error);
}

tc_minmax *tc_minmax_build(const tc_volume *volume, int block, int reach, tc_pool *pool, GError **error) {
  tc_minmax *m = tc_minmax_begin(volume, block, reach, error);
  if (!m || tc_minmax_go_on(m, volume, pool, error)) return m;
  tc_minmax_free(m);
  return NULL;
}

void tc_minmax_free(tc_minmax *minmax) {
  if (!minmax) return;
  free(minmax->pairs);
  free(minmax);
}

double tc_minmax_value(const tc_minmax *m, size_t i) { return tc_voxel_at(m->type, m->pairs, i); }
