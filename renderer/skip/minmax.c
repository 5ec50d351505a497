#include <stdlib.h>

#include "renderer/skip/minmax_rows.h"
#include "renderer/base/clock.h"
#include "renderer/volume/voxel.h"

int tc_skip_block(int block) {
  if (block <= 0) return TC_SKIP_BLOCK;
  return block < 2 ? 2 : block > 128 ? 128 : block;
}

int tc_skip_reach(tc_filter filter) { return filter == TC_FILTER_CUBIC; }

typedef struct minmax_job {
  const tc_volume *volume;
  tc_minmax *m;
  size_t row_bytes; /* of voxels */
  char *rows; /* per worker: a row of minima and a row of maxima */
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
  static void row_##name(const tc_minmax *m, const type *voxels, const int *dims, int by, int bz, type *lo, type *pair) { \
    type *hi = lo + dims[0];                                                                                         \
    int nx = dims[0], y0 = first_voxel(m, by), y1 = last_voxel(m, by, dims[1]);                                      \
    int z0 = first_voxel(m, bz), z1 = last_voxel(m, bz, dims[2]);                                                    \
    for (int z = z0; z <= z1; z++)                                                                                   \
      for (int y = y0; y <= y1; y++) {                                                                               \
        const type *p = voxels + ((size_t)z * (size_t)dims[1] + (size_t)y) * (size_t)nx;                             \
        if (z == z0 && y == y0)                                                                                      \
          for (int x = 0; x < nx; x++) lo[x] = hi[x] = p[x];                                                         \
        else                                                                                                         \
          for (int x = 0; x < nx; x++) {                                                                             \
            lo[x] = p[x] < lo[x] ? p[x] : lo[x];                                                                     \
            hi[x] = p[x] > hi[x] ? p[x] : hi[x];                                                                     \
          }                                                                                                          \
      }                                                                                                              \
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

void tc_minmax_row(const tc_minmax *m, const tc_volume *volume, int by, int bz, void *scratch, void *pairs) {
  const void *voxels = tc_volume_data(volume);
  const int *dims = tc_volume_describe(volume)->dims;
  switch (m->type) {
  case TC_U8: row_u8(m, voxels, dims, by, bz, scratch, pairs); break;
  case TC_I8: row_i8(m, voxels, dims, by, bz, scratch, pairs); break;
  case TC_U16: row_u16(m, voxels, dims, by, bz, scratch, pairs); break;
  case TC_I16: row_i16(m, voxels, dims, by, bz, scratch, pairs); break;
  case TC_F32: row_f32(m, voxels, dims, by, bz, scratch, pairs); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

static void minmax_task(void *context, int index, int worker) {
  const minmax_job *job = context;
  const tc_minmax *m = job->m;
  size_t row = (size_t)m->blocks[0] * 2 * tc_voxel_size(m->type);
  tc_minmax_row(m, job->volume, index % m->blocks[1], index / m->blocks[1],
                job->rows + (size_t)worker * 2 * job->row_bytes, (char *)m->pairs + (size_t)index * row);
}

size_t tc_minmax_blocks(const tc_volume *volume, int block, int blocks[3]) {
  const int *dims = tc_volume_describe(volume)->dims;
  size_t count = 1;
  for (int k = 0; k < 3; k++) {
    int cells = dims[k] > 1 ? dims[k] - 1 : 1;
    blocks[k] = (cells + block - 1) / block;
    count *= (size_t)blocks[k];
  }
  return count;
}

tc_minmax *tc_minmax_begin(const tc_volume *volume, int block, int reach, GError **error) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  tc_minmax *m = calloc(1, sizeof *m);
  if (m) {
    *m = (tc_minmax){.block = block, .reach = reach, .type = d->type};
    const size_t count = tc_minmax_blocks(volume, block, m->blocks);
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
  minmax_job job = {.volume = volume, .m = m, .row_bytes = (size_t)d->dims[0] * tc_voxel_size(d->type)};
  if (m->done == m->blocks[1] * m->blocks[2]) return true;
  job.rows = malloc((size_t)tc_pool_threads(pool) * 2 * job.row_bytes);
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
