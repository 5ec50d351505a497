/* The full pre-integration table in O(n^2) (NUMERICS section 3).
 *
 * Entry (i, k) is the composite of the k elementary segments i .. i+k-1, each of length d/k. Segments are (R, G, B,
 * alpha), and the over operator is associative, so the entries of a diagonal k are products over sliding windows of
 * width k. Block suffix times block prefix (van Herk, Gil-Werman) gives each entry in a constant number of
 * compositions, without division and hence without cancellation, however stiff the extinction is.
 *
 * Entries hold opacity, not optical depth: in single precision, from a depth of 16.7 per segment on, 1 - opacity is
 * 0. Opacity correction of a ray's shorter last segment needs the depth, which is in the row of depths. */
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "renderer/classify/outline.h"
#include "renderer/classify/segments.h"
#include "renderer/classify/transfer.h"
#include "renderer/base/clock.h"

/* A table, with the state that tc_table_fill() needs to resume and to copy entries from it. */
typedef struct made {
  tc_table table; /* must be first: the public part */
  tc_v4 peak;     /* the largest value of each channel, and 1 */
  tc_segments axes[1 + TC_MAX_SUBTABLES]; /* of the table and of each subtable */
  tc_v4 *rows;    /* row k = 0 and the row of depths, for the table and each subtable */
  size_t mapped;  /* bytes of the entries with their padding */
  float *begun;   /* unfinished entries ... */
  int window, diagonal; /* ... and the next diagonal to make */
} made;

/* The table or a subtable whose entries are computed. */
typedef struct builder {
  const tc_segments *axis;
  double step_mm;
  int columns;
  tc_v4 *zero;      /* row k = 0 */
  const tc_v4 *old; /* row k = 0 of the table to copy from, or NULL ... */
  int first, last;  /* ... and the intervals in which it differs */
  tc_v4 peak;       /* the largest value of each channel, and 1 */
  tc_v4 *scratch;   /* per worker: 4 arrays with an entry per interval */
} builder;

/* ---- diagonals ---- */

/* Colour and opacity round separately: clamps colour to opacity times peak, to the last bit, and both to their
 * bounds. */
static tc_v4 clamped(tc_v4 entry, tc_v4 peak) {
  entry = tc_v4_greater(tc_v4_lesser(entry, peak), (tc_v4){0, 0, 0, 0});
  return tc_v4_lesser(entry, entry[3] * peak);
}

static void diagonal_zero(const tc_segments *axis, double step_mm, tc_v4 peak, tc_v4 *zero) {
  for (int i = 0; i <= axis->count; i++) {
    const tc_table_params *p = axis->params;
    double v = tc_segments_value(axis, i), w = -expm1(-tc_extinction(p->tf, v) * step_mm), rgb[3];
    tc_segments_color(p, v, rgb);
    zero[i] = clamped((tc_v4){(float)(rgb[0] * w), (float)(rgb[1] * w), (float)(rgb[2] * w), (float)w}, peak);
  }
}

/* Elementary segments in both directions, scratch for the suffixes of a block, and the output rows: towards higher
 * nodes and towards lower ones. */
typedef struct lanes {
  tc_v4 *ef, *eb, *sf, *sb, *out_f, *out_b;
} lanes;

/* Windows `from` to `to` of width k. Blocks begin at multiples of k for any range, so that a window is always the same
 * product, to the last bit. */
static void sliding_windows(const lanes *l, int k, int from, int to, tc_v4 peak) {
  tc_v4 *out_f = l->out_f, *out_b = l->out_b;
  for (int start = from - from % k; start <= to; start += k) {
    const tc_v4 *ef = l->ef + start, *eb = l->eb + start;
    int first = from > start ? from - start : 0, last = to - start < k ? to - start : k - 1;
    tc_product f = {ef[k - 1], {0}}, r = {eb[k - 1], {0}};
    l->sf[k - 1] = f.sum, l->sb[k - 1] = r.sum;
    for (int j = k - 2; j >= first; j--) {
      tc_put_before(&f, ef[j]);
      tc_put_behind(&r, eb[j]);
      l->sf[j] = f.sum, l->sb[j] = r.sum;
    }
    if (first == 0) out_f[start] = clamped(f.sum, peak), out_b[start] = clamped(r.sum, peak);
    if (last == 0) continue;
    tc_product pf = {ef[k], {0}}, pb = {eb[k], {0}};
    for (int j = 1; j <= last; j++) {
      if (j > 1) {
        tc_put_behind(&pf, ef[k + j - 1]);
        tc_put_before(&pb, eb[k + j - 1]);
      }
      if (j < first) continue;
      out_f[start + j] = clamped(tc_v4_over(l->sf[j], pf.sum), peak);
      out_b[start + j] = clamped(tc_v4_over(pb.sum, l->sb[j]), peak);
    }
  }
}

static void copy_windows(const builder *b, int k, int from, int to) {
  if (from > to) return;
  size_t size = (size_t)(to - from + 1) * sizeof(tc_v4);
  ptrdiff_t up = k * (ptrdiff_t)b->columns + from, down = from - k * (ptrdiff_t)b->columns;
  memcpy(b->zero + up, b->old + up, size);
  memcpy(b->zero + down, b->old + down, size);
}

static void build_diagonal(void *context, int index, int worker) {
  builder *b = context;
  /* Alternates long and short diagonals, so that workers finish together. */
  int m = b->axis->count, k = index % 2 ? m - index / 2 : 1 + index / 2;
  int from = 0, to = m - k;
  if (b->old) { /* windows that do not touch a differing interval were copied */
    from = b->first - k + 1 > 0 ? b->first - k + 1 : 0;
    to = b->last < to ? b->last : to;
    if (from > to) from = to = -1;
    copy_windows(b, k, 0, from - 1);
    copy_windows(b, k, to + 1, m - k);
    if (to < 0) return;
  }
  lanes l = {.ef = b->scratch + (size_t)worker * 4 * (size_t)m};
  l.eb = l.ef + m, l.sf = l.eb + m, l.sb = l.sf + m;
  tc_segments_integrate(b->axis, b->step_mm / k, from, to + k, l.ef, l.eb);
  l.out_f = b->zero + k * (ptrdiff_t)b->columns, l.out_b = b->zero - k * (ptrdiff_t)b->columns;
  sliding_windows(&l, k, from, to, b->peak);
}

/* ---- memory ---- */

/* The entries of the table freed last are kept for the next table of the same shape: page faults take longer than
 * filling the entries, many times as long in a virtual machine. Entries that no look-up reads are zero in both
 * tables. */
typedef struct spare {
  float *entries;
  size_t mapped;
  int n, n_subtables;
} spare;
static spare kept;
static pthread_mutex_t keeping = PTHREAD_MUTEX_INITIALIZER;

static spare swap_spare(spare with) {
  pthread_mutex_lock(&keeping);
  const spare before = kept;
  kept = with;
  pthread_mutex_unlock(&keeping);
  return before;
}

static void unmap(spare s) {
  if (s.entries) munmap(s.entries, s.mapped);
}

#define PAGE ((size_t)2 << 20)
#define MOST_SPARE (20 * PAGE) /* keeps tables of up to 1024 nodes, 34 MB; no budget counts these bytes */

/* Zeroed memory, in huge pages if available. What lies behind the last whole one is in small pages: a second huge page added 4 ms
 * to the build of a table of 256 nodes, at its first touch (virtual machine, AMD EPYC, Zen 3). The largest tables use small
 * pages alone, because no look-up reads half of their entries, whose pages are then never allocated. */
static void *reserve(size_t *bytes) {
  const size_t page = PAGE;
  bool large = *bytes >= page / 2 && *bytes <= 32 * page;
  const size_t size = large && *bytes < page ? page : (*bytes + 4095) & ~(size_t)4095, spare = large ? page : 0;
  char *from = mmap(NULL, size + spare, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (from == MAP_FAILED) return NULL;
  size_t before = large ? (size_t)(-(uintptr_t)from) & (page - 1) : 0;
  if (before) munmap(from, before);
  if (spare > before) munmap(from + before + size, spare - before);
  if (large) madvise(from + before, size & ~(page - 1), MADV_HUGEPAGE); /* failure only costs time */
  *bytes = size;
  return from + before;
}

/* Number of entries, including the row of depths (k = n + 2). */
static size_t table_entries(int n, int columns) { return (2 * ((size_t)n + 1) + 2) * (size_t)columns; }

/* Columns for nodes 0 .. n only: up to 4096 nodes, entry numbers are then exact in single precision. */
static made *table_new(const tc_table_params *p) {
  static atomic_uint_fast64_t next_serial = 1;
  made *m = aligned_alloc(16, sizeof *m);
  if (!m) return NULL;
  memset(m, 0, sizeof *m);
  tc_table *t = &m->table;
  *t = (tc_table){.n = p->n, .columns = p->n + 1, .lo = p->voxel_lo, .hi = p->voxel_hi, .step_mm = p->step_mm,
                  .bits = p->bits, .n_subtables = p->n_subtables};
  t->serial = atomic_fetch_add(&next_serial, 1);
  size_t own = table_entries(p->n, t->columns), each = table_entries(TC_SUBTABLE_NODES, TC_SUBTABLE_NODES + 2);
  t->bytes = (own + (size_t)p->n_subtables * each) * sizeof(tc_v4);
  t->starts[0] = (size_t)(p->n + 1) * (size_t)t->columns;
  for (int i = 0; i < p->n_subtables; i++) {
    t->subtables[i] = p->subtables[i];
    t->starts[1 + i] = own + (size_t)i * each + (TC_SUBTABLE_NODES + 1) * (TC_SUBTABLE_NODES + 2);
  }
  return m;
}

void tc_table_free(tc_table *table) {
  made *m = (made *)table;
  if (!m) return;
  for (int w = 0; w <= table->n_subtables; w++) tc_segments_finish(&m->axes[w]);
  const spare own = {m->begun, m->mapped, table->n, table->n_subtables};
  if (m->begun) unmap(m->mapped <= MOST_SPARE ? swap_spare(own) : own);
  free(m->rows);
  free(m);
}

static tc_v4 brightest(const tc_table_params *p) {
  tc_v4 peak = {0, 0, 0, 1};
  for (size_t i = 0; i < p->tf->count; i++)
    for (int c = 0; c < 3; c++) {
      double x = p->tf->points[i].color[c];
      peak[c] = fmaxf(peak[c], (float)(p->linear_light ? tc_srgb_to_linear(x) : x));
    }
  return peak;
}

/* Allocates m->begun. */
static bool map_entries(made *m) {
  const tc_table *t = &m->table;
  /* The padding makes the neighbour of the last row readable, which a look-up reads with weight 0. */
  m->mapped = t->bytes + (size_t)(t->n + TC_SUBTABLE_NODES) * sizeof(tc_v4);
  const spare like = m->mapped <= MOST_SPARE ? swap_spare((spare){0}) : (spare){0};
  if (like.entries && like.n == t->n && like.n_subtables == t->n_subtables) {
    m->begun = like.entries;
    m->mapped = like.mapped;
    return true;
  }
  unmap(like);
  m->begun = reserve(&m->mapped);
  return m->begun != NULL;
}

static size_t rows_start(const tc_table *t, int w) {
  return w ? 2 * ((size_t)t->n + 1 + (size_t)(w - 1) * (TC_SUBTABLE_NODES + 1)) : 0;
}

static bool say_no_memory(int n, GError **error) {
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "pre-integration table of %d values a side: out of memory", n);
  return false;
}

tc_table *tc_table_outline(const tc_table_params *params, const tc_halt *halt, GError **error) {
  double start = tc_now_ms();
  made *m = table_new(params);
  if (m) m->rows = aligned_alloc(16, rows_start(&m->table, params->n_subtables + 1) * sizeof(tc_v4));
  bool ok = (m && m->rows) || say_no_memory(params->n, error);
  if (ok) m->peak = brightest(params);
  for (int w = 0; ok && w <= params->n_subtables; w++) { /* w = 0: the table itself */
    const tc_subtable *sub = w ? &params->subtables[w - 1] : NULL;
    const double range[2] = {sub ? sub->lo : params->voxel_lo, sub ? sub->hi : params->voxel_hi};
    tc_segments *axis = &m->axes[w];
    ok = tc_segments_make(axis, params, range, w ? TC_SUBTABLE_NODES : params->n, halt, error);
    tc_v4 *rows = m->rows + rows_start(&m->table, w);
    if (ok) {
      diagonal_zero(axis, params->step_mm, m->peak, rows);
      tc_segments_depths(axis, params->step_mm, rows + axis->count + 1);
    }
    axis->params = NULL;
  }
  if (!ok) {
    tc_table_free((tc_table *)m);
    return NULL;
  }
  m->table.build_ms = tc_now_ms() - start;
  return &m->table;
}

/* ---- entries ---- */

static void round_entries(const builder *b, int bits) {
  ptrdiff_t reach = 4 * (b->axis->count + 1) * (ptrdiff_t)b->columns;
  float *entry = (float *)b->zero - reach;
  for (ptrdiff_t i = 0; i < 2 * reach + 4 * b->columns; i++)
    if (entry[i] != 0) entry[i] = tc_table_round(entry[i], bits);
}

static bool fill_window(made *m, int w, const made *like, tc_v4 *scratch, tc_pool *pool) {
  const tc_segments *axis = &m->axes[w];
  const tc_table *t = &m->table;
  builder b = {.axis = axis, .step_mm = t->step_mm, .columns = w ? TC_SUBTABLE_NODES + 2 : t->columns, .peak = m->peak,
               .scratch = scratch, .last = axis->count - 1};
  b.zero = (tc_v4 *)(w ? t->subtable_rows[w - 1] : t->zero_row);
  if (like && w <= like->table.n_subtables) {
    b.old = (const tc_v4 *)(w ? like->table.subtable_rows[w - 1] : like->table.zero_row);
    if (!tc_segments_compare(axis, &like->axes[w], &b.first, &b.last)) b.first = axis->count, b.last = -1;
  }
  const tc_v4 *rows = m->rows + rows_start(t, w);
  size_t row_bytes = ((size_t)axis->count + 1) * sizeof *rows;
  memcpy(b.zero, rows, row_bytes);
  if (!tc_pool_go_on(pool, &m->diagonal, axis->count, build_diagonal, &b)) return false;
  m->diagonal = 0;
  if (t->bits) round_entries(&b, t->bits);
  memcpy(b.zero + (axis->count + 2) * (ptrdiff_t)b.columns, rows + axis->count + 1, row_bytes);
  return true;
}

bool tc_table_fill(tc_table *t, const tc_table *old, tc_pool *pool, GError **error) {
  double start = tc_now_ms();
  made *m = (made *)t;
  const made *like = (const made *)old;
  if (like && (!old->entries || old->n != t->n || old->step_mm != t->step_mm || old->bits != t->bits ||
               memcmp(&like->peak, &m->peak, sizeof m->peak)))
    like = NULL;
  size_t most = t->n_subtables && t->n < TC_SUBTABLE_NODES ? TC_SUBTABLE_NODES : (size_t)t->n;
  tc_v4 *scratch = aligned_alloc(16, (size_t)tc_pool_threads(pool) * 4 * most * sizeof *scratch);
  if (!scratch || (!m->begun && !map_entries(m))) {
    free(scratch);
    return say_no_memory(t->n, error);
  }
  t->zero_row = m->begun + 4 * t->starts[0];
  for (int z = 0; z < t->n_subtables; z++) t->subtable_rows[z] = m->begun + 4 * t->starts[1 + z];
  while (m->window <= t->n_subtables && fill_window(m, m->window, like, scratch, pool)) m->window++;
  free(scratch);
  if (m->window > t->n_subtables) t->entries = m->begun;
  t->build_ms += tc_now_ms() - start;
  return t->entries || tc_halt_say(tc_pool_halt(pool), error);
}

int64_t tc_table_steps(const tc_table *table) {
  const made *m = (const made *)table;
  return ((int64_t)m->window << 32) + m->diagonal;
}

tc_table *tc_table_build(const tc_table_params *params, tc_pool *pool, GError **error) {
  tc_table *t = tc_table_outline(params, tc_pool_halt(pool), error);
  if (!t || tc_table_fill(t, NULL, pool, error)) return t;
  tc_table_free(t);
  return NULL;
}

size_t tc_table_held(const tc_table *table) {
  const made *m = (const made *)table;
  size_t bytes = rows_start(table, table->n_subtables + 1) * sizeof(tc_v4) + (table->entries ? table->bytes : 0);
  for (int w = 0; w <= table->n_subtables; w++) bytes += tc_segments_bytes(&m->axes[w]);
  return bytes;
}

tc_table_window tc_table_window_of(const tc_table *table, int w) {
  const made *m = (const made *)table;
  const tc_segments *axis = &m->axes[w];
  return (tc_table_window){.intervals = axis->count,
                           .columns = w ? TC_SUBTABLE_NODES + 2 : table->columns,
                           .start = table->starts[w],
                           .diagonal = (const float *)(m->rows + rows_start(table, w)),
                           .depths = (const float *)(m->rows + rows_start(table, w) + axis->count + 1),
                           .peak = {m->peak[0], m->peak[1], m->peak[2]},
                           .first = axis->first,
                           .n_pieces = axis->n_pieces};
}

void tc_table_window_pieces(const tc_table *table, int w, float (*pieces)[8]) {
  tc_segments_ends(&((const made *)table)->axes[w], table->step_mm, pieces);
}
