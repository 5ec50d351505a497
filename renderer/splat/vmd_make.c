/* Builds a model from bits of filled voxels: rows of columns are encoded in parallel and then joined. */
#include <stdlib.h>
#include <string.h>

#include "renderer/splat/vmd.h"

typedef struct row {
  GByteArray *bytes, *records; /* records: buffer for the records of one run */
  uint32_t *lengths;           /* [size x]; NULL until it is made, and where there are no columns */
} row;

typedef struct making {
  const tc_vmd_source *source;
  const int *dims, *first, *size; /* grid; rectangle of columns that are made */
  int words;
  uint64_t **bits; /* [threads][4][words][nx]: the row, its shell, and rows beside it */
  row *rows;       /* [size y] */
  const tc_vmd_part *part; /* NULL: of a source that says which voxels are filled */
  atomic_bool short_of_memory;
} making;

static void fill(const making *m, int y, uint64_t *bits) {
  memset(bits, 0, (size_t)m->words * (size_t)m->dims[0] * sizeof *bits);
  if (y >= 0 && y < m->dims[1]) m->source->fill(m->source->user, y, bits);
}

/* Keeps only voxels that have a free neighbour; voxels outside the grid are free. */
static void peel(const making *m, int y, uint64_t *bits, uint64_t *work) {
  const size_t nx = (size_t)m->dims[0], n = (size_t)m->words * nx;
  uint64_t *before = work, *behind = work + n, *inside = work + 2 * n;
  fill(m, y - 1, before);
  fill(m, y + 1, behind);
  for (size_t i = 0; i < n; i++) {
    uint64_t left = i % nx > 0 ? bits[i - 1] : 0, right = i % nx + 1 < nx ? bits[i + 1] : 0;
    uint64_t under = bits[i] << 1 | (i >= nx ? bits[i - nx] >> 63 : 0);
    uint64_t over = bits[i] >> 1 | (i + nx < n ? bits[i + nx] << 63 : 0);
    inside[i] = left & right & under & over & before[i] & behind[i];
  }
  for (size_t i = 0; i < n; i++) bits[i] &= ~inside[i];
}

/* First z' >= z at which the column is filled (or free); the grid's depth if there is none. */
static int next_change(const making *m, const uint64_t *column, int z, bool to_filled) {
  const int nz = m->dims[2];
  while (z < nz) {
    uint64_t word = column[(size_t)(z / 64) * (size_t)m->dims[0]];
    word = (to_filled ? word : ~word) >> z % 64;
    if (word) return MIN(z + __builtin_ctzll(word), nz);
    z = (z / 64 + 1) * 64;
  }
  return nz;
}

#define WORTH 4              /* bytes: cost of two more runs; equal records are split off where they save more */
#define MOST_SAME (1u << 28) /* voxels of a run */

/* Counts the leading records that equal the first of n. */
static guint same_from(const uint8_t *records, guint n, guint size) {
  guint i = 1;
  while (i < MIN(n, MOST_SAME) && (!size || memcmp(records + (size_t)i * size, records, size) == 0)) i++;
  return i;
}

/* Appends a run of filled voxels, split into adjacent runs where enough neighbours have equal records. `before`: in, the
 * record of the voxel before the run; out, of its last voxel. */
static void put_run(GByteArray *to, uint32_t gap, const uint8_t *records, guint n, guint size, uint8_t *before) {
  for (guint at = 0, count; at < n; at += count, gap = 0) {
    const uint8_t *from = records + (size_t)at * size;
    count = same_from(from, n - at, size);
    guint kind = TC_VMD_EACH;
    if (count == n - at || (count - 1) * size > WORTH)
      kind = memcmp(from, before, size) == 0 ? TC_VMD_AS_BEFORE : TC_VMD_SAME;
    for (guint more; kind == TC_VMD_EACH && at + count < n && count < MOST_SAME; count += more) {
      more = same_from(from + (size_t)count * size, n - at - count, size);
      if ((more - 1) * size > WORTH) break;
    }
    tc_vmd_put_varint(to, count << 2 | kind);
    tc_vmd_put_varint(to, gap);
    g_byte_array_append(to, from, (kind == TC_VMD_EACH ? count : kind == TC_VMD_SAME) * size);
    memcpy(before, from + (size_t)(count - 1) * size, size);
  }
}

static void put_column(const making *m, const row *r, const uint64_t *column, int x, int y) {
  const int nz = m->dims[2], record = m->source->head.record_bytes;
  uint8_t before[4 * TC_VMD_ATTRIBUTES] = {0};
  for (int z = 0, start, end = 0;; z = end) {
    start = next_change(m, column, z, true);
    if (start >= nz) break;
    end = next_change(m, column, start, false);
    g_byte_array_set_size(r->records, (guint)(end - start) * (guint)record + 1);
    memset(r->records->data, 0, r->records->len); /* attributes without a source are 0 */
    for (int i = start; i < end && record; i++)
      m->source->record(m->source->user, x, y, i, r->records->data + (size_t)(i - start) * (size_t)record);
    put_run(r->bytes, (uint32_t)(start - z), r->records->data, (guint)(end - start), (guint)record, before);
  }
  tc_vmd_put_varint(r->bytes, 0);
}

static bool any_filled(const making *m, const uint64_t *column) {
  uint64_t any = 0;
  for (int w = 0; w < m->words; w++) any |= column[(size_t)w * (size_t)m->dims[0]];
  return any != 0;
}

static void make_row(void *context, int y, int worker) {
  making *m = context;
  const size_t n = (size_t)m->words * (size_t)m->dims[0];
  row *r = &m->rows[y];
  r->lengths = calloc((size_t)m->dims[0], sizeof *r->lengths);
  if (!r->lengths) {
    atomic_store(&m->short_of_memory, true);
    return;
  }
  r->bytes = g_byte_array_new(), r->records = g_byte_array_new();
  uint64_t *bits = m->bits[worker];
  fill(m, y, bits);
  if (m->source->shell) peel(m, y, bits, bits + n);
  for (int x = 0; x < m->dims[0]; x++) {
    guint before = r->bytes->len;
    if (any_filled(m, bits + x)) put_column(m, r, bits + x, x, y);
    r->lengths[x] = r->bytes->len - before;
  }
  g_clear_pointer(&r->records, g_byte_array_unref);
}

/* ---- part of a model: from runs to runs, so that nothing is as large as the grid ---- */

static void end_run(row *r, int *before, int start, int end) {
  uint8_t none = 0;
  if (end > start) put_run(r->bytes, (uint32_t)(start - *before), &none, (guint)(end - start), 0, &none);
  if (end > start) *before = end;
}

static void put_part(const tc_vmd_part *p, row *r, const uint8_t *column) {
  const guint empty = r->bytes->len;
  int before = 0, start = 0, end = 0;
  for (tc_vmd_run run = {.at = column}; tc_vmd_next(p->of, &run);)
    for (int i = 0, count; i < run.count; i += count) {
      const int z = run.z + i;
      count = run.step ? 1 : run.count; /* voxels that share a record */
      if (!p->keeps(p->user, run.records + (size_t)i * run.step)) continue;
      if (z != end) end_run(r, &before, start, end), start = z;
      end = z + count;
    }
  end_run(r, &before, start, end);
  if (r->bytes->len > empty) tc_vmd_put_varint(r->bytes, 0);
}

static void part_row(void *context, int y, int worker) {
  making *m = context;
  row *r = &m->rows[y];
  for (int x = 0; x < m->size[0]; x++) {
    const uint8_t *column = tc_vmd_column(m->part->of, m->first[0] + x, m->first[1] + y);
    if (!column) continue;
    if (!r->lengths) {
      r->lengths = calloc((size_t)m->size[0], sizeof *r->lengths);
      if (!r->lengths) {
        atomic_store(&m->short_of_memory, true);
        return;
      }
      r->bytes = g_byte_array_new();
    }
    const guint before = r->bytes->len;
    put_part(m->part, r, column);
    r->lengths[x] = r->bytes->len - before;
  }
}

/* ---- rows to a model ---- */

/* Bounding rectangle of the stored columns; empty if there are none. */
static void find_rectangle(const making *m, int first[2], int size[2]) {
  int lo[2] = {m->size[0], m->size[1]}, hi[2] = {-1, -1};
  for (int y = 0; y < m->size[1]; y++)
    for (int x = 0; m->rows[y].lengths && x < m->size[0]; x++) {
      if (!m->rows[y].lengths[x]) continue;
      lo[0] = MIN(lo[0], x), hi[0] = MAX(hi[0], x);
      lo[1] = MIN(lo[1], y), hi[1] = MAX(hi[1], y);
    }
  for (int k = 0; k < 2; k++) {
    first[k] = hi[k] < 0 ? 0 : lo[k];
    size[k] = hi[k] < 0 ? 0 : hi[k] + 1 - lo[k];
  }
}

static tc_vmd *join(const making *m, const tc_vmd_head *head, GError **error) {
  tc_vmd_columns to = {0};
  uint64_t total = 0;
  for (int y = 0; y < m->size[1]; y++) total += m->rows[y].bytes ? m->rows[y].bytes->len : 0;
  if (total > UINT32_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "voxel model: more than 4 GiB; choose fewer voxels or attributes");
    return NULL;
  }
  find_rectangle(m, to.first, to.size);
  to.bytes = g_try_malloc(total + 1);
  to.lengths = calloc((size_t)to.size[0] * (size_t)to.size[1] + 1, sizeof *to.lengths);
  tc_vmd *v = NULL;
  if (to.bytes && to.lengths) {
    size_t at = 0;
    for (int y = 0; y < to.size[1]; y++) {
      const row *r = &m->rows[to.first[1] + y];
      if (!r->lengths) continue;
      if (r->bytes->len) memcpy(to.bytes + at, r->bytes->data, r->bytes->len);
      at += r->bytes->len;
      memcpy(to.lengths + (size_t)y * (size_t)to.size[0], r->lengths + to.first[0],
             (size_t)to.size[0] * sizeof *to.lengths);
    }
    for (int k = 0; k < 2; k++) to.first[k] += m->first[k];
    v = tc_vmd_new(TC_VMD_VERSION, head, &to, error);
  } else {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: no memory for %" G_GUINT64_FORMAT " bytes", total);
  }
  free(to.lengths);
  if (!v) g_free(to.bytes);
  return v;
}

static bool begin(making *m, tc_pool *pool) {
  const int threads = tc_pool_threads(pool);
  if (m->part) return (m->rows = calloc((size_t)m->size[1] + 1, sizeof *m->rows)) != NULL;
  const size_t n = (size_t)m->words * (size_t)m->dims[0] * (m->source->shell ? 4 : 1);
  bool good = (m->bits = calloc((size_t)threads, sizeof *m->bits)) != NULL;
  for (int i = 0; i < threads && good; i++) good = (m->bits[i] = malloc(n * sizeof **m->bits)) != NULL;
  return good && (m->rows = calloc((size_t)m->size[1], sizeof *m->rows)) != NULL;
}

static void finish(making *m, tc_pool *pool) {
  for (int i = 0; m->bits && i < tc_pool_threads(pool); i++) free(m->bits[i]);
  free(m->bits);
  for (int y = 0; m->rows && y < m->size[1]; y++) {
    if (m->rows[y].bytes) g_byte_array_unref(m->rows[y].bytes);
    free(m->rows[y].lengths);
  }
  free(m->rows);
}

static tc_vmd *make(making *m, const tc_vmd_head *head, tc_pool *pool, GError **error) {
  tc_vmd *v = NULL;
  if (!begin(m, pool)) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: out of memory");
  } else if (!tc_pool_run(pool, m->size[1], m->part ? part_row : make_row, m)) {
    tc_halt_say(tc_pool_halt(pool), error);
  } else if (atomic_load(&m->short_of_memory)) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: out of memory");
  } else {
    v = join(m, head, error);
  }
  finish(m, pool);
  return v;
}

tc_vmd *tc_vmd_make(const tc_vmd_source *source, tc_pool *pool, GError **error) {
  static const int corner[2] = {0, 0};
  const int *dims = source->head.grid.dims;
  making m = {.source = source, .dims = dims, .first = corner, .size = dims, .words = (dims[2] + 63) / 64};
  if (MAX(dims[0], MAX(dims[1], dims[2])) <= TC_VMD_SIDE) return make(&m, &source->head, pool, error);
  tc_set_error(error, TC_ERROR_LIMIT, NULL, "voxel model: %dx%dx%d: at most %d voxels along an axis; crop the volume",
               dims[0], dims[1], dims[2], TC_VMD_SIDE);
  return NULL;
}

tc_vmd *tc_vmd_make_part(const tc_vmd_part *part, tc_pool *pool, GError **error) {
  const tc_vmd *of = part->of;
  const tc_vmd_head head = {.grid = of->head.grid};
  making m = {.dims = of->head.grid.dims, .first = of->first, .size = of->size, .part = part};
  return make(&m, &head, pool, error);
}
