#include "renderer/skip/bounds.h"
#include "renderer/base/clock.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#define MOST_LEVEL 254

/* The added eighth of a level covers the rounding of (best - floor) * scale in kernels. */
static inline uint8_t level_of(const tc_bounds *b, double lo, double hi) {
  const double below = lo < 0 ? -lo : lo, above = hi < 0 ? -hi : hi;
  double most = b->grey.sign > 0 ? hi : -lo;
  most += lo != hi ? 1e-6 * (below > above ? below : above) : 0;
  if (most <= (double)b->grey.floor) return 0;
  const double level = (most - (double)b->grey.floor) * (double)b->scale + 0.125;
  if (!(level <= MOST_LEVEL)) return 255;
  const int whole = (int)level;
  return (uint8_t)(whole + (level > whole)); /* rounded up */
}

#define LEVELS(name, type)                                                                                             \
  static void levels_##name(tc_bounds *b, const type *pairs, size_t from, size_t to) {                                 \
    for (size_t i = from; i < to; i++) b->levels[i] = level_of(b, (double)pairs[2 * i], (double)pairs[2 * i + 1]);     \
  }
LEVELS(u8, uint8_t)
LEVELS(i8, int8_t)
LEVELS(u16, uint16_t)
LEVELS(i16, int16_t)
LEVELS(f32, float)

static void fill_levels(tc_bounds *b, const tc_minmax *m, size_t from, size_t to) {
  switch (m->type) {
  case TC_U8: levels_u8(b, m->pairs, from, to); break;
  case TC_I8: levels_i8(b, m->pairs, from, to); break;
  case TC_U16: levels_u16(b, m->pairs, from, to); break;
  case TC_I16: levels_i16(b, m->pairs, from, to); break;
  case TC_F32: levels_f32(b, m->pairs, from, to); break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
}

/* A plain loop over arrays, which the compiler vectorises. */
static void largest(const uint8_t *before, const uint8_t *here, const uint8_t *after, uint8_t *restrict to, size_t n) {
  for (size_t i = 0; i < n; i++) {
    const uint8_t most = before[i] > here[i] ? before[i] : here[i];
    to[i] = most > after[i] ? most : after[i];
  }
}

/* Replaces each of `count` rows of n levels, `stride` apart, by the largest of itself and its two neighbours. rows:
 * room for three, the first of them zero. */
static void widen(uint8_t *first, size_t n, int count, size_t stride, uint8_t *rows) {
  const uint8_t *before = rows;
  for (int i = 0; i < count; i++) {
    uint8_t *row = first + (size_t)i * stride, *here = rows + (size_t)(1 + i % 2) * n;
    memcpy(here, row, n);
    largest(before, here, i + 1 < count ? row + stride : rows, row, n);
    before = here;
  }
}

typedef struct bounds_job {
  tc_bounds *bounds;
  const tc_minmax *minmax;
  uint8_t *rows; /* scratch of each worker: three rows and two more levels */
} bounds_job;

static uint8_t *rows_of(const bounds_job *job, int worker) {
  return job->rows + (size_t)worker * (3 * (size_t)job->bounds->blocks[0] + 2);
}

/* A layer of blocks, widened along x and y. */
static void layer_task(void *context, int z, int worker) {
  const bounds_job *job = context;
  tc_bounds *b = job->bounds;
  size_t nx = (size_t)b->blocks[0], ny = (size_t)b->blocks[1], first = (size_t)z * nx * ny;
  uint8_t *rows = rows_of(job, worker), *copy = rows + nx; /* between two zeros */
  fill_levels(b, job->minmax, first, first + nx * ny);
  for (size_t y = 0; y < ny; y++) {
    uint8_t *row = b->levels + first + y * nx;
    copy[0] = copy[nx + 1] = 0;
    memcpy(copy + 1, row, nx);
    largest(copy, copy + 1, copy + 2, row, nx);
  }
  widen(b->levels + first, nx, b->blocks[1], nx, rows);
}

/* A row of every layer, widened along z. */
static void row_task(void *context, int y, int worker) {
  const bounds_job *job = context;
  const tc_bounds *b = job->bounds;
  size_t nx = (size_t)b->blocks[0], layer = nx * (size_t)b->blocks[1];
  widen(b->levels + (size_t)y * nx, nx, b->blocks[2], layer, rows_of(job, worker));
}

int tc_bounds_interval(const tc_bounds *bounds, const tc_rays *rays) {
  double fastest = 0; /* most voxels per mm along any axis, for any direction of a ray */
  for (int k = 0; k < 3; k++) {
    const double *row = rays->to_index + 3 * k;
    fastest = fmax(fastest, sqrt(row[0] * row[0] + row[1] * row[1] + row[2] * row[2]));
  }
  /* The margin of a fiftieth of a voxel is far above the rounding of positions. */
  double each_side = (bounds->block - 0.02) / (fastest * rays->step_mm);
  return each_side < 1e6 ? 1 + (int)(2 * each_side) : 2000000;
}

tc_bounds *tc_bounds_build(const tc_minmax *m, const tc_grey *grey, tc_pool *pool, GError **error) {
  static atomic_uint_fast64_t serials;
  double start = tc_now_ms();
  size_t count = 1;
  tc_bounds *b = calloc(1, sizeof *b);
  if (b) {
    *b = (tc_bounds){.block = m->block, .reach = m->reach, .grey = *grey, .serial = atomic_fetch_add(&serials, 1) + 1};
    for (int k = 0; k < 3; k++) {
      b->blocks[k] = m->blocks[k];
      count *= (size_t)b->blocks[k];
    }
    b->bytes = count + 8;
    b->levels = calloc(b->bytes, 1);
  }
  uint8_t *rows = b ? calloc((size_t)tc_pool_threads(pool), 3 * (size_t)b->blocks[0] + 2) : NULL;
  if (!b || !b->levels || !rows) {
    free(rows);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "bounds of the blocks: out of memory");
    tc_bounds_free(b);
    return NULL;
  }
  /* With floor = stop every ray is finished at its first sample; a scale of 0 keeps levels at 1. */
  double span = (double)grey->stop - (double)grey->floor;
  b->scale = span > 0 ? (float)fmin(MOST_LEVEL / span, 1e30) : 0;
  bounds_job job = {b, m, rows};
  bool made = tc_pool_run(pool, b->blocks[2], layer_task, &job) && tc_pool_run(pool, b->blocks[1], row_task, &job);
  free(rows);
  b->build_ms = tc_now_ms() - start;
  if (made) return b;
  tc_halt_say(tc_pool_halt(pool), error);
  tc_bounds_free(b);
  return NULL;
}

void tc_bounds_free(tc_bounds *bounds) {
  if (!bounds) return;
  free(bounds->levels);
  free(bounds);
}
