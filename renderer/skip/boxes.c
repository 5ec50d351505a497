#include "renderer/skip/boxes.h"

#include <limits.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/clock.h"
#include "renderer/skip/runs.h"

#define FINE TC_BOX_FINE
#define PIECE 5 /* cells cut at once: a row of their voxels at one byte each fits a 64-bit word, even with a reach of 1 */
#define ROWS (PIECE + 4)
#define TASK_VOXELS (1 << 19) /* voxels per task: some milliseconds at most */
#define INLINE static inline __attribute__((always_inline)) /* so that `reach` is a constant */

/* The records that one worker found. */
typedef struct found {
  tc_box *items;
  size_t count, capacity, empty; /* empty: blocks */
  bool failed;
} found;

typedef struct tc_boxing {
  const void *voxels;      /* both borrowed during a call */
  const tc_minmax *minmax;
  tc_runs runs;
  int dims[3], cells[3];
  bool *full; /* blocks without any empty cell */
  int strips, rows; /* tasks per two layers of blocks; rows of blocks per task, even */
  int next;   /* task */
  int n_workers;
  found *workers;
} boxes_job;

static void emit(found *f, const int at[3], int size, uint32_t fine) {
  if (f->count == f->capacity) {
    size_t capacity = f->capacity ? 2 * f->capacity : 4096;
    tc_box *items = realloc(f->items, capacity * sizeof *items);
    if (!items) {
      f->failed = true;
      return;
    }
    f->items = items;
    f->capacity = capacity;
  }
  f->items[f->count++] = (tc_box){{(uint16_t)at[0], (uint16_t)at[1], (uint16_t)at[2]}, (uint16_t)size, fine};
}

static int least(int a, int b) { return a < b ? a : b; }

/* rows[z][y]: one byte per voxel with its set of empty runs (skip/runs.h), for `cells` cells along x and `reach`
 * voxels more on both sides, from at[0] - reach on. Bytes, rows and layers outside the volume have all bits set. */
INLINE void read_rows(const boxes_job *job, const int at[3], const int cells[3], int reach, uint64_t rows[ROWS][ROWS]) {
  int from[3], to[3]; /* in rows */
  for (int k = 0; k < 3; k++) {
    from[k] = at[k] < reach ? reach - at[k] : 0;
    to[k] = least(cells[k] + 1 + 2 * reach, job->dims[k] - at[k] + reach);
  }
  for (int z = 0; z < PIECE + 3 + reach; z++)
    for (int y = 0; y < PIECE + 3 + reach; y++) {
      rows[z][y] = ~(uint64_t)0;
      if (z < from[2] || z >= to[2] || y < from[1] || y >= to[1]) continue;
      size_t row = (size_t)(at[2] + z - reach) * (size_t)job->dims[1] + (size_t)(at[1] + y - reach);
      size_t first = row * (size_t)job->dims[0] + (size_t)(at[0] + from[0] - reach);
      tc_runs_read(&job->runs, job->voxels, first, to[0] - from[0], (uint8_t *)&rows[z][y] + from[0]);
    }
}

/* The occupied fine boxes of a piece: those whose voxels' sets share no bit. *all: none is empty. */
INLINE uint32_t cut_piece(const boxes_job *job, const int at[3], const int cells[3], int reach, bool *all) {
  uint64_t rows[ROWS][ROWS];
  uint32_t fine = 0;
  int n[3], last = FINE + 2 * reach; /* voxels along a fine box, less one */
  for (int k = 0; k < 3; k++) n[k] = (cells[k] + FINE - 1) / FINE;
  read_rows(job, at, cells, reach, rows);
  for (int z = 0; z < PIECE + 3 + reach; z++)
    for (int y = 0; y < PIECE + 3 + reach; y++) {
      uint64_t missing = ~rows[z][y];
      for (int k = 1; k <= last; k++) rows[z][y] &= ~(missing >> 8 * k);
    }
  *all = true;
  for (int z = 0; z < n[2]; z++)
    for (int y = 0; y < n[1]; y++) {
      uint64_t common = ~(uint64_t)0;
      for (int k = 0; k <= last; k++)
        for (int j = 0; j <= last; j++) common &= rows[FINE * z + k][FINE * y + j];
      for (int x = 0; x < n[0]; x++) {
        bool some = !(common >> (8 * FINE * x) & 255);
        fine |= (uint32_t)some << ((z * TC_BOX_FINES + y) * TC_BOX_FINES + x);
        *all = *all && some;
      }
    }
  return fine;
}

/* Emits the records of a block; a block without any empty cell is not emitted, but reported by returning true. */
static bool cut_block(const boxes_job *job, const int at[3], found *out) {
  int b = job->minmax->block, end[3], p[3], cells[3];
  bool single = b <= PIECE;
  for (int k = 0; k < 3; k++) end[k] = least(at[k] + b, job->cells[k]);
  for (p[2] = at[2]; p[2] < end[2]; p[2] += PIECE)
    for (p[1] = at[1]; p[1] < end[1]; p[1] += PIECE)
      for (p[0] = at[0]; p[0] < end[0]; p[0] += PIECE) {
        for (int k = 0; k < 3; k++) cells[k] = least(PIECE, end[k] - p[k]);
        bool all;
        uint32_t fine = job->minmax->reach ? cut_piece(job, p, cells, 1, &all) : cut_piece(job, p, cells, 0, &all);
        if (single && all) return true;
        if (fine) emit(out, p, PIECE, all ? 0 : fine);
      }
  return false;
}

static size_t block_index(const tc_minmax *m, int x, int y, int z) {
  return ((size_t)z * (size_t)m->blocks[1] + (size_t)y) * (size_t)m->blocks[0] + (size_t)x;
}

static void sort_rows(boxes_job *job, int y0, int y1, int z, found *out) {
  const tc_minmax *m = job->minmax;
  for (int y = y0; y < y1; y++)
    for (int x = 0; x < m->blocks[0]; x++) {
      size_t i = block_index(m, x, y, z);
      double lo = tc_minmax_value(m, 2 * i), hi = tc_minmax_value(m, 2 * i + 1);
      const int at[3] = {x * m->block, y * m->block, z * m->block};
      if (tc_runs_set(&job->runs, lo) & tc_runs_set(&job->runs, hi))
        out->empty++;
      else
        job->full[i] = tc_runs_miss(&job->runs, lo, hi) || cut_block(job, at, out);
    }
}

/* A strip of two layers of blocks. Eight full blocks around a corner merge into one box. */
static void boxes_task(void *context, int index, int worker) {
  boxes_job *job = context;
  const tc_minmax *m = job->minmax;
  found *out = &job->workers[worker];
  int z0 = index / job->strips * 2, z1 = least(z0 + 2, m->blocks[2]);
  int first = index % job->strips * job->rows, end = least(first + job->rows, m->blocks[1]);
  for (int z = z0; z < z1; z++) sort_rows(job, first, end, z, out);
  for (int y0 = first; y0 < end; y0 += 2)
    for (int x0 = 0; x0 < m->blocks[0]; x0 += 2) {
      int count = 0, corner[8][3];
      for (int c = 0; c < 8; c++) {
        int x = x0 + (c & 1), y = y0 + (c >> 1 & 1), z = z0 + (c >> 2);
        if (x >= m->blocks[0] || y >= m->blocks[1] || z >= z1 || !job->full[block_index(m, x, y, z)]) continue;
        corner[count][0] = x * m->block, corner[count][1] = y * m->block, corner[count++][2] = z * m->block;
      }
      if (count == 8)
        emit(out, corner[0], 2 * m->block, 0);
      else
        for (int c = 0; c < count; c++) emit(out, corner[c], m->block, 0);
    }
}

static bool join(tc_boxes *boxes, size_t blocks) {
  const boxes_job *job = boxes->begun;
  size_t empty = 0;
  bool failed = false;
  boxes->count = 0;
  for (int i = 0; i < job->n_workers; i++) {
    boxes->count += job->workers[i].count;
    empty += job->workers[i].empty;
    failed = failed || job->workers[i].failed;
  }
  boxes->empty_share = (double)empty / (double)blocks;
  boxes->bytes = boxes->count * sizeof *boxes->items;
  boxes->items = failed ? NULL : malloc(boxes->bytes + 1);
  tc_box *to = boxes->items;
  for (int i = 0; i < job->n_workers && to; i++) {
    size_t count = job->workers[i].count;
    if (count) memcpy(to, job->workers[i].items, count * sizeof *to);
    to += count;
  }
  return boxes->items != NULL;
}

static size_t block_count(const tc_minmax *m) {
  return (size_t)m->blocks[0] * (size_t)m->blocks[1] * (size_t)m->blocks[2];
}

static void end_boxing(tc_boxes *boxes) {
  boxes_job *job = boxes->begun;
  if (!job) return;
  for (int i = 0; i < job->n_workers && job->workers; i++) free(job->workers[i].items);
  free(job->workers);
  free(job->full);
  tc_runs_finish(&job->runs);
  free(job);
  boxes->begun = NULL;
}

static bool say_no_memory(GError **error) {
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "boxes of what shows: out of memory");
  return false;
}

bool tc_boxes_serve(const tc_volume *volume) {
  const int *dims = tc_volume_describe(volume)->dims;
  return dims[0] <= TC_BOX_REACH && dims[1] <= TC_BOX_REACH && dims[2] <= TC_BOX_REACH;
}

tc_boxes *tc_boxes_begin(const tc_volume *volume, const tc_minmax *minmax, const tc_support *support, tc_pool *pool,
                         GError **error) {
  double start = tc_now_ms();
  const tc_volume_desc *d = tc_volume_describe(volume);
  tc_boxes *boxes = calloc(1, sizeof *boxes);
  boxes_job *job = calloc(1, sizeof *job);
  if (boxes) boxes->begun = job;
  if (job) {
    job->n_workers = tc_pool_threads(pool);
    job->full = calloc(block_count(minmax), sizeof *job->full);
    job->workers = calloc((size_t)job->n_workers, sizeof *job->workers);
  }
  if (!boxes || !job || !job->full || !job->workers) {
    if (!boxes) free(job);
    tc_boxes_free(boxes);
    say_no_memory(error);
    return NULL;
  }
  if (!tc_runs_init(&job->runs, support, d->type, error)) {
    tc_boxes_free(boxes);
    return NULL;
  }
  for (int k = 0; k < 3; k++) {
    job->dims[k] = d->dims[k];
    job->cells[k] = d->dims[k] > 1 ? d->dims[k] - 1 : 1;
  }
  int64_t row_voxels = 2 * (int64_t)minmax->block * minmax->block * d->dims[0];
  job->rows = 2 * (int)(1 + TASK_VOXELS / 2 / row_voxels);
  job->strips = (minmax->blocks[1] + job->rows - 1) / job->rows;
  boxes->block = minmax->block;
  boxes->support = support->serial;
  boxes->zero_below = job->runs.zero_below;
  boxes->zero_above = job->runs.zero_above;
  boxes->build_ms = tc_now_ms() - start;
  return boxes;
}

bool tc_boxes_go_on(tc_boxes *boxes, const tc_volume *volume, const tc_minmax *minmax, tc_pool *pool, GError **error) {
  double start = tc_now_ms();
  boxes_job *job = boxes->begun;
  if (!job) return true;
  job->voxels = tc_volume_data(volume);
  job->minmax = minmax;
  bool made = tc_pool_go_on(pool, &job->next, (minmax->blocks[2] + 1) / 2 * job->strips, boxes_task, job);
  bool joined = made && join(boxes, block_count(minmax));
  if (joined) end_boxing(boxes);
  boxes->build_ms += tc_now_ms() - start;
  return joined || (made ? say_no_memory(error) : tc_halt_say(tc_pool_halt(pool), error));
}

int tc_boxes_steps(const tc_boxes *boxes) { return boxes->begun ? boxes->begun->next : INT_MAX; }

void tc_boxes_free(tc_boxes *boxes) {
  if (!boxes) return;
  end_boxing(boxes);
  free(boxes->items);
  free(boxes);
}
