#include "renderer/skip/boxes.h"

#include <emmintrin.h>
#include <limits.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/clock.h"
#include "renderer/skip/fine.h"

#define FINES TC_BOX_FINES
#define GROUP (TC_FINE_GROUP / FINES) /* records tested together */
#define THIRDS 0x249249249249 /* the first of every three bits, of 48 */
#define TASK_FINES (1 << 20) /* fine boxes per task: a millisecond at most */

/* The records that one worker found. */
typedef struct found {
  tc_box *items;
  size_t count, capacity, empty; /* empty: records */
  bool failed;
} found;

typedef struct tc_boxing {
  const tc_fine *fine; /* borrowed during a call */
  tc_fine_ranges ranges;
  __m128i from[TC_FINE_RANGES], to[TC_FINE_RANGES]; /* their bounds, sixteen times */
  int n[3];         /* records along each axis */
  bool *full;       /* records without any empty fine box */
  int strips, rows; /* tasks per two layers of records; rows of records per task, even */
  int next;         /* task */
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

/* Which of sixteen pairs of bins lie in an empty range, one bit each. */
static unsigned empty_bits(const boxes_job *job, __m128i least, __m128i most) {
  __m128i empty = _mm_setzero_si128();
  for (int r = 0; r < job->ranges.count; r++) {
    const __m128i inside = _mm_and_si128(_mm_cmpeq_epi8(_mm_max_epu8(least, job->from[r]), least),
                                         _mm_cmpeq_epi8(_mm_min_epu8(most, job->to[r]), most));
    empty = _mm_or_si128(empty, inside);
  }
  return (unsigned)_mm_movemask_epi8(empty);
}

static __m128i sixteen(const uint8_t *p) { return _mm_loadu_si128((const __m128i *)(const void *)p); }

/* Which of sixteen groups, from number `group` of each of the rows on, are empty in all rows, one bit each. */
static unsigned empty_groups(const boxes_job *job, const size_t *row, int rows, int group) {
  __m128i least = _mm_set1_epi8(-1), most = _mm_setzero_si128();
  for (int k = 0; k < rows; k++) {
    const size_t at = row[k] * (size_t)job->fine->groups + (size_t)group;
    least = _mm_min_epu8(least, sixteen(job->fine->group_least + at));
    most = _mm_max_epu8(most, sixteen(job->fine->group_most + at));
  }
  return empty_bits(job, least, most);
}

/* Bits of the occupied ones (in no empty range) of `count` fine boxes from number `at` on, at most a group. */
static uint64_t read_bits(const boxes_job *job, size_t at, int count) {
  const uint8_t *minima = job->fine->least + at, *maxima = job->fine->most + at;
  /* Rows are too short for the processor's own prefetcher. */
  const uintptr_t ahead = 2 * FINES * (uintptr_t)job->fine->grid.blocks[0]; /* of the next two records */
  uint64_t some = 0;
  for (int x = 0; x < count; x += 16) {
    __builtin_prefetch((const void *)((uintptr_t)(minima + x) + ahead));
    __builtin_prefetch((const void *)((uintptr_t)(maxima + x) + ahead));
    some |= (uint64_t)(0xffff ^ empty_bits(job, sixteen(minima + x), sixteen(maxima + x))) << x;
  }
  return some & ~(uint64_t)0 >> (64 - count);
}

/* Emits the records of a row. Full ones are only marked, because they may be merged. Returns whether there are any. */
static bool cut_row(boxes_job *job, int y, int z, found *out) {
  const int *n = job->fine->grid.blocks, w = job->fine->grid.block;
  bool *full = job->full + ((size_t)z * (size_t)job->n[1] + (size_t)y) * (size_t)job->n[0];
  int place[FINES * FINES], rows = 0;
  size_t number[FINES * FINES]; /* of a row of fine boxes */
  unsigned empty_of_16 = 0;
  bool marked = false;
  for (int k = 0; k < FINES * FINES; k++) {
    const int fy = FINES * y + k % FINES, fz = FINES * z + k / FINES;
    if (fy >= n[1] || fz >= n[2]) continue;
    number[rows] = (size_t)fz * (size_t)n[1] + (size_t)fy;
    place[rows++] = FINES * k;
  }
  for (int x0 = 0; x0 < job->n[0]; x0 += GROUP) {
    const int group = x0 / GROUP, records = least(GROUP, job->n[0] - x0);
    if (group % 16 == 0) empty_of_16 = empty_groups(job, number, rows, group);
    if (empty_of_16 >> group % 16 & 1) {
      out->empty += (size_t)records;
      continue;
    }
    const int left = n[0] - FINES * x0; /* fine boxes of the row */
    uint64_t row[FINES * FINES], any = 0, all = left < FINES * GROUP ? ~(uint64_t)0 << left : 0, common = ~(uint64_t)0;
    for (int k = 0; k < rows; k++) {
      row[k] = read_bits(job, number[k] * (size_t)n[0] + (size_t)(FINES * x0), least(left, TC_FINE_GROUP));
      any |= row[k];
      common &= row[k];
    }
    all |= common;
    const uint64_t there = THIRDS & ~(uint64_t)0 >> (64 - FINES * records);
    any = (any | any >> 1 | any >> 2) & there;
    all = all & all >> 1 & all >> 2 & any;
    out->empty += (size_t)(records - __builtin_popcountll(any));
    marked = marked || all;
    for (uint64_t rest = all; rest; rest &= rest - 1) full[x0 + __builtin_ctzll(rest) / FINES] = true;
    for (uint64_t rest = any & ~all; rest; rest &= rest - 1) {
      const int bit = __builtin_ctzll(rest), at[3] = {(x0 * FINES + bit) * w, FINES * y * w, FINES * z * w};
      uint32_t fine = 0;
      for (int k = 0; k < rows; k++) fine |= (uint32_t)(row[k] >> bit & 7) << place[k];
      emit(out, at, FINES * w, fine);
    }
  }
  return marked;
}

/* Emits the full records of the rows from y[0] to before y[1] in the layers from z[0] to before z[1], at most two each. Eight
 * around a corner merge into one box. */
static void merge_rows(const boxes_job *job, const int y[2], const int z[2], found *out) {
  const int size = FINES * job->fine->grid.block;
  for (int x0 = 0; x0 < job->n[0]; x0 += 2) {
    int count = 0, corner[8][3];
    for (int layer = z[0]; layer < z[1]; layer++)
      for (int row = y[0]; row < y[1]; row++) {
        const bool *full = job->full + ((size_t)layer * (size_t)job->n[1] + (size_t)row) * (size_t)job->n[0];
        for (int x = x0; x < least(x0 + 2, job->n[0]); x++) {
          if (!full[x]) continue;
          corner[count][0] = x * size, corner[count][1] = row * size, corner[count++][2] = layer * size;
        }
      }
    if (count == 8)
      emit(out, corner[0], 2 * size, 0);
    else
      for (int c = 0; c < count; c++) emit(out, corner[c], size, 0);
  }
}

/* Processes a strip of two layers of records. */
static void boxes_task(void *context, int index, int worker) {
  boxes_job *job = context;
  found *out = &job->workers[worker];
  const int z0 = index / job->strips * 2, z[2] = {z0, least(z0 + 2, job->n[2])};
  const int first = index % job->strips * job->rows, end = least(first + job->rows, job->n[1]);
  for (int y0 = first; y0 < end; y0 += 2) {
    const int y[2] = {y0, least(y0 + 2, end)};
    bool marked = false;
    for (int layer = z[0]; layer < z[1]; layer++)
      for (int row = y[0]; row < y[1]; row++) marked |= cut_row(job, row, layer, out);
    if (marked) merge_rows(job, y, z, out);
  }
}

static size_t record_count(const boxes_job *job) { return (size_t)job->n[0] * (size_t)job->n[1] * (size_t)job->n[2]; }

static bool join(tc_boxes *boxes) {
  const boxes_job *job = boxes->begun;
  size_t empty = 0;
  bool failed = false;
  boxes->count = 0;
  for (int i = 0; i < job->n_workers; i++) {
    boxes->count += job->workers[i].count;
    empty += job->workers[i].empty;
    failed = failed || job->workers[i].failed;
  }
  boxes->empty_share = (double)empty / (double)record_count(job);
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

static void end_boxing(tc_boxes *boxes) {
  boxes_job *job = boxes->begun;
  if (!job) return;
  for (int i = 0; i < job->n_workers && job->workers; i++) free(job->workers[i].items);
  free(job->workers);
  free(job->full);
  free(job);
  boxes->begun = NULL;
}

static bool say_no_memory(GError **error) {
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "occupied boxes: out of memory");
  return false;
}

bool tc_boxes_serve(const tc_volume *volume) {
  const int *dims = tc_volume_describe(volume)->dims;
  return dims[0] <= TC_BOX_REACH && dims[1] <= TC_BOX_REACH && dims[2] <= TC_BOX_REACH;
}

static bool reserve(boxes_job *job) {
  job->full = calloc(record_count(job), sizeof *job->full);
  job->workers = calloc((size_t)job->n_workers, sizeof *job->workers);
  return job->full && job->workers;
}

tc_boxes *tc_boxes_begin(const tc_fine *fine, const tc_support *support, tc_pool *pool, GError **error) {
  double start = tc_now_ms();
  tc_boxes *boxes = calloc(1, sizeof *boxes);
  boxes_job *job = calloc(1, sizeof *job);
  if (boxes) boxes->begun = job;
  if (boxes && job) {
    for (int k = 0; k < 3; k++) job->n[k] = (fine->grid.blocks[k] + FINES - 1) / FINES;
    job->n_workers = tc_pool_threads(pool);
  }
  if (!boxes || !job || !reserve(job)) {
    if (!boxes) free(job);
    tc_boxes_free(boxes);
    say_no_memory(error);
    return NULL;
  }
  if (!tc_fine_find_ranges(fine, support, &job->ranges, error)) {
    tc_boxes_free(boxes);
    return NULL;
  }
  for (int r = 0; r < job->ranges.count; r++) {
    job->from[r] = _mm_set1_epi8((char)job->ranges.first[r]);
    job->to[r] = _mm_set1_epi8((char)job->ranges.last[r]);
  }
  const int64_t two_rows = 4 * FINES * FINES * (int64_t)fine->grid.blocks[0];
  job->rows = 2 * (int)(1 + TASK_FINES / two_rows);
  job->strips = (job->n[1] + job->rows - 1) / job->rows;
  boxes->block = fine->grid.block;
  boxes->support = support->serial;
  boxes->build_ms = tc_now_ms() - start;
  return boxes;
}

bool tc_boxes_go_on(tc_boxes *boxes, const tc_fine *fine, tc_pool *pool, GError **error) {
  double start = tc_now_ms();
  boxes_job *job = boxes->begun;
  if (!job) return true;
  job->fine = fine;
  bool made = tc_pool_go_on(pool, &job->next, (job->n[2] + 1) / 2 * job->strips, boxes_task, job);
  bool joined = made && join(boxes);
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
