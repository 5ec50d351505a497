/* The full pre-integration table in O(n^2) (NUMERICS section 3).
 *
 * Entry (i, k) is the composite of the k elementary segments i .. i+k-1, each of length d/k. A segment is (R, G, B, alpha)
 * and two of them compose with "over", which is associative, so the entries of one diagonal k are products over sliding
 * windows of width k: block suffix times block prefix (van Herk, Gil-Werman) gives each in a constant number of
 * compositions, with no subtraction and hence no cancellation however stiff the extinction is. */
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "renderer/classify/classify.h"
#include "renderer/clock.h"

typedef float v4 __attribute__((vector_size(16)));

/* A stretch of the value axis inside one node interval with linear colour and (nearly) linear extinction. */
typedef struct piece {
  float width; /* share of the node interval */
  bool graded; /* colour changes along it */
  double mean; /* of the extinction, 1/mm, exact */
  double tilt; /* extinction = mean * (1 + tilt * (2u - 1)), |tilt| <= 1 */
  double from[3], to[3]; /* colour, compositing space */
} piece;

typedef struct builder {
  const tc_table_params *params;
  double lo, hi; /* of the table or zoom at hand */
  double step_mm;
  int columns;
  float *zero_row;
  piece *pieces;
  uint32_t *first; /* [intervals + 1] into pieces */
  uint32_t count, capacity;
  v4 *scratch; /* per worker: 4 arrays of `intervals` */
  int intervals;
} builder;

/* ---- pieces ---- */

static double node_value(const builder *b, double node) {
  return b->params->slope * (b->lo + (b->hi - b->lo) * node / (b->intervals - 1)) + b->params->intercept;
}

static void color_in(const tc_table_params *p, double value, double rgb[3]) {
  tc_color(p->tf, value, rgb);
  if (p->linear_light)
    for (int c = 0; c < 3; c++) rgb[c] = tc_srgb_to_linear(rgb[c]);
}

static bool add_piece(builder *b, double width, double v0, double v1) {
  if (b->count == b->capacity) {
    uint32_t capacity = b->capacity ? 2 * b->capacity : 1024;
    piece *grown = realloc(b->pieces, capacity * sizeof *grown);
    if (!grown) return false;
    b->pieces = grown;
    b->capacity = capacity;
  }
  piece *q = &b->pieces[b->count++];
  /* One-sided limits: a jump may lie at either end, so the ends are looked up a hair inside. */
  double in0 = v0 + (v1 - v0) * 1e-9, in1 = v1 - (v1 - v0) * 1e-9;
  q->width = (float)width;
  q->mean = tc_extinction_mean(b->params->tf, v0, v1);
  double tau0 = tc_extinction(b->params->tf, in0), tau1 = tc_extinction(b->params->tf, in1);
  q->tilt = q->mean > 0 ? fmin(fmax((tau1 - tau0) / (2 * q->mean), -1), 1) : 0;
  color_in(b->params, in0, q->from);
  color_in(b->params, in1, q->to);
  q->graded = fabs(q->to[0] - q->from[0]) + fabs(q->to[1] - q->from[1]) + fabs(q->to[2] - q->from[2]) > 1e-7;
  return true;
}

/* Opacity knots make extinction logarithmic in the value: cut where it bends (only matters where colour changes too). */
static bool add_bent(builder *b, double width, double v0, double v1) {
  double c0[3], c1[3], in0 = v0 + (v1 - v0) * 1e-9, in1 = v1 - (v1 - v0) * 1e-9;
  double bend = 0;
  if (b->params->tf->kind == TC_KNOT_OPACITY) {
    tc_color(b->params->tf, in0, c0);
    tc_color(b->params->tf, in1, c1);
    if (c0[0] != c1[0] || c0[1] != c1[1] || c0[2] != c1[2])
      bend = fabs(tc_extinction(b->params->tf, in1) - tc_extinction(b->params->tf, in0)) *
             b->params->tf->unit_distance_mm; /* = |ln((1-a1)/(1-a0))| */
  }
  int cuts = (int)fmin(ceil(bend / 0.25), 64);
  if (cuts < 1) cuts = 1;
  for (int i = 0; i < cuts; i++)
    if (!add_piece(b, width / cuts, v0 + (v1 - v0) * i / cuts, v0 + (v1 - v0) * (i + 1) / cuts)) return false;
  return true;
}

/* A node interval with very many knots in it: a few pieces with the exact mean extinction and the mean of the emitted colour
 * each. What is between the nodes is then below what a lookup can resolve, and the time to build stays bounded. */
enum { MOST_KNOTS = 8, MERGED_PIECES = 4, MERGE_PROBES = 32 };

static bool merge_pieces(builder *b, uint32_t first, double v0, double v1) {
  b->count = first;
  for (int i = 0; i < MERGED_PIECES; i++) {
    double from = v0 + (v1 - v0) * i / MERGED_PIECES, to = v0 + (v1 - v0) * (i + 1) / MERGED_PIECES, weight = 0, sum[3] = {0};
    if (!add_piece(b, 1.0 / MERGED_PIECES, from, to)) return false;
    for (int j = 0; j < MERGE_PROBES; j++) {
      double v = from + (to - from) * (j + 0.5) / MERGE_PROBES, tau = tc_extinction(b->params->tf, v), rgb[3];
      color_in(b->params, v, rgb);
      for (int c = 0; c < 3; c++) sum[c] += tau * rgb[c];
      weight += tau;
    }
    piece *q = &b->pieces[b->count - 1];
    if (weight > 0)
      for (int c = 0; c < 3; c++) q->from[c] = q->to[c] = sum[c] / weight;
    q->graded = false;
  }
  return true;
}

static bool cut_into_pieces(builder *b) {
  const tc_transfer_function *tf = b->params->tf;
  bool rising = b->params->slope > 0;
  /* next: the first knot ahead in the direction the value moves along the nodes. */
  ptrdiff_t count = (ptrdiff_t)tf->count, next = rising ? 0 : count - 1;
  for (int j = 0; j < b->intervals; j++) {
    b->first[j] = b->count;
    double v0 = node_value(b, j), v1 = node_value(b, j + 1), from = v0;
    int knots = 0;
    while (next >= 0 && next < count && (rising ? tf->points[next].value <= v0 : tf->points[next].value >= v0))
      next += rising ? 1 : -1;
    for (; next >= 0 && next < count; next += rising ? 1 : -1) {
      double k = tf->points[next].value;
      if (rising ? k >= v1 : k <= v1) break;
      if (k != from && !add_bent(b, (k - from) / (v1 - v0), from, k)) return false;
      from = k;
      knots++;
    }
    if (!add_bent(b, (v1 - from) / (v1 - v0), from, v1)) return false;
    if (knots > MOST_KNOTS && !merge_pieces(b, b->first[j], v0, v1)) return false;
  }
  b->first[b->intervals] = b->count;
  return true;
}

/* ---- elementary segments ---- */

/* Integral over u in [0,1] of exp(-a u - a b u (u - 1)), both for tilt b and for -b (the same stretch seen from its other
 * end), |a b| <= 0.05: expanded in a b, each term in closed form. t = exp(-a). */
typedef struct decay { double ahead, behind; } decay;

static decay decay_integral(double a, double b, double t) {
  double x = a * b, i0, i1, i2;
  if (a < 0.05) {
    i0 = 1 - a * (1.0 / 2 - a * (1.0 / 6 - a * (1.0 / 24 - a / 120)));
    i1 = 1.0 / 6 - a * (1.0 / 12 - a * (1.0 / 40 - a / 180));
    i2 = 1.0 / 30 - a * (1.0 / 60 - a / 210);
  } else {
    double r = 1 / a, r3 = r * r * r;
    i0 = (1 - t) * r;
    i1 = ((a - 2) + (a + 2) * t) * r3;
    i2 = (2 * (a * a - 6 * a + 12) - 2 * (a * a + 6 * a + 12) * t) * r3 * r * r;
  }
  return (decay){i0 + x * (i1 + 0.5 * x * i2), i0 - x * (i1 - 0.5 * x * i2)};
}

/* Light and opacity where `near` is met first; q: how much of the light comes from the far end (the integral of u dW). */
static v4 emit(double w, double q, const double near[3], const double far[3]) {
  q = fmin(fmax(q, 0), w);
  return (v4){(float)(near[0] * (w - q) + far[0] * q), (float)(near[1] * (w - q) + far[1] * q),
              (float)(near[2] * (w - q) + far[2] * q), (float)w};
}

static v4 over(v4 front, v4 back) { return front + (1 - front[3]) * back; }

/* A piece whose colour changes, cut so that each part's a*b is small; parts behind an opaque front are not looked at. */
static v4 cut_piece(const piece *p, double a, bool reverse, int parts) {
  const double *from = reverse ? p->to : p->from, *to = reverse ? p->from : p->to;
  double tilt = reverse ? -p->tilt : p->tilt;
  v4 sum = {0, 0, 0, 0};
  for (int i = 0; i < parts && sum[3] < 1 - 1e-7f; i++) {
    double u0 = (double)i / parts, u1 = (double)(i + 1) / parts, c0[3], c1[3];
    double mean = 1 + tilt * (u0 + u1 - 1); /* relative extinction of this part; 0 at a tip with |tilt| = 1 */
    for (int c = 0; c < 3; c++) {
      c0[c] = from[c] + u0 * (to[c] - from[c]);
      c1[c] = from[c] + u1 * (to[c] - from[c]);
    }
    double bent = mean > 0 ? fmin(fmax(tilt / parts / mean, -1), 1) : 0, part = a * mean / parts, w = -expm1(-part);
    sum = over(sum, emit(w, decay_integral(part, bent, 1 - w).ahead - (1 - w), c0, c1));
  }
  return sum;
}

static void graded_piece(const piece *p, double a, v4 *forward, v4 *backward) {
  double bend = fabs(a * p->tilt);
  if (bend <= 0.05) {
    double w = -expm1(-a);
    decay d = decay_integral(a, p->tilt, 1 - w);
    *forward = emit(w, d.ahead - (1 - w), p->from, p->to);
    *backward = emit(w, d.behind - (1 - w), p->to, p->from);
    return;
  }
  int parts = (int)fmin(ceil(sqrt(bend / 0.05)), 1e6);
  *forward = cut_piece(p, a, false, parts);
  *backward = cut_piece(p, a, true, parts);
}

static v4 flat_piece(const piece *p, double a) {
  double w = -expm1(-a);
  return (v4){(float)(p->from[0] * w), (float)(p->from[1] * w), (float)(p->from[2] * w), (float)w};
}

/* The node interval j as one segment of length `length_mm`, both ways. */
static void elementary(const builder *b, int j, double length_mm, v4 *forward, v4 *backward) {
  v4 f = {0, 0, 0, 0}, r = {0, 0, 0, 0};
  for (uint32_t i = b->first[j]; i < b->first[j + 1]; i++) {
    const piece *p = &b->pieces[i];
    double a = p->mean * (double)p->width * length_mm;
    if (!(a > 0)) continue;
    v4 pf, pr;
    if (p->graded)
      graded_piece(p, a, &pf, &pr);
    else
      pf = pr = flat_piece(p, a);
    f = over(f, pf);
    r = over(pr, r);
  }
  *forward = f;
  *backward = r;
}

/* ---- diagonals ---- */

static void diagonal_zero(builder *b) {
  v4 *row = (v4 *)b->zero_row;
  for (int i = 0; i <= b->intervals; i++) {
    double v = node_value(b, i), w = -expm1(-tc_extinction(b->params->tf, v) * b->step_mm), rgb[3];
    color_in(b->params, v, rgb);
    row[i] = (v4){(float)(rgb[0] * w), (float)(rgb[1] * w), (float)(rgb[2] * w), (float)w};
  }
}

/* Windows of width k over m elementary segments, towards higher nodes (out_f) and towards lower ones (out_b). */
static void sliding_windows(const v4 *ef, const v4 *eb, v4 *sf, v4 *sb, int m, int k, v4 *out_f, v4 *out_b) {
  for (int start = 0; start + k <= m; start += k) {
    v4 f = ef[start + k - 1], r = eb[start + k - 1];
    sf[k - 1] = f, sb[k - 1] = r;
    for (int j = k - 2; j >= 0; j--) {
      sf[j] = f = over(ef[start + j], f);
      sb[j] = r = over(r, eb[start + j]);
    }
    out_f[start] = f, out_b[start] = r;
    if (start + k >= m) break;
    v4 pf = ef[start + k], pb = eb[start + k];
    for (int j = 1; j < k && start + j + k <= m; j++) {
      if (j > 1) {
        pf = over(pf, ef[start + k + j - 1]);
        pb = over(eb[start + k + j - 1], pb);
      }
      out_f[start + j] = over(sf[j], pf);
      out_b[start + j] = over(pb, sb[j]);
    }
  }
}

static void build_diagonal(void *context, int index, int worker) {
  builder *b = context;
  /* Long and short diagonals in turn, so that workers finish together. */
  int m = b->intervals, k = index % 2 ? m - index / 2 : 1 + index / 2;
  v4 *ef = b->scratch + (size_t)worker * 4 * (size_t)m, *eb = ef + m, *sf = eb + m, *sb = sf + m;
  for (int j = 0; j < m; j++) elementary(b, j, b->step_mm / k, &ef[j], &eb[j]);
  ptrdiff_t stride = b->columns;
  v4 *zero = (v4 *)b->zero_row;
  sliding_windows(ef, eb, sf, sb, m, k, zero + k * stride, zero - k * stride);
}

/* ---- life ---- */

static size_t table_entries(int n) { return (2 * ((size_t)n + 1) + 1) * ((size_t)n + 2); }

static tc_table *table_new(const tc_table_params *p) {
  static atomic_uint_fast64_t next_serial = 1;
  tc_table *t = calloc(1, sizeof *t);
  if (!t) return NULL;
  t->n = p->n;
  t->columns = p->n + 2;
  t->lo = p->voxel_lo, t->hi = p->voxel_hi;
  t->step_mm = p->step_mm;
  t->n_zooms = p->n_zooms;
  t->serial = atomic_fetch_add(&next_serial, 1);
  size_t own = table_entries(p->n), each = table_entries(TC_ZOOM_NODES);
  t->bytes = (own + (size_t)p->n_zooms * each) * sizeof(v4);
  /* mmap: zeroed, and the half that no lookup reaches is never touched. The pad lets a lookup at the last row read its
   * (zero-weighted) neighbour. */
  void *memory = mmap(NULL, t->bytes + (size_t)t->columns * sizeof(v4) + 64, PROT_READ | PROT_WRITE,
                      MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
  if (memory == MAP_FAILED) {
    free(t);
    return NULL;
  }
  t->entries = memory;
  t->zero_row = t->entries + (size_t)(p->n + 1) * (size_t)t->columns * 4;
  for (int i = 0; i < p->n_zooms; i++) {
    t->zooms[i] = p->zooms[i];
    t->zoom_rows[i] = t->entries + 4 * (own + (size_t)i * each + (TC_ZOOM_NODES + 1) * (TC_ZOOM_NODES + 2));
  }
  return t;
}

void tc_table_free(tc_table *table) {
  if (!table) return;
  munmap(table->entries, table->bytes + (size_t)table->columns * sizeof(v4) + 64);
  free(table);
}

/* The table itself, or one of its zooms. */
static bool build_window(builder *b, tc_pool *pool, tc_zoom window, int n, float *zero_row) {
  b->lo = window.lo, b->hi = window.hi;
  b->intervals = n;
  b->columns = n + 2;
  b->zero_row = zero_row;
  b->count = 0;
  if (!cut_into_pieces(b)) return false;
  diagonal_zero(b);
  tc_pool_run(pool, n, build_diagonal, b);
  return true;
}

tc_table *tc_table_build(const tc_table_params *params, tc_pool *pool, GError **error) {
  double start = tc_now_ms();
  tc_table *t = table_new(params);
  builder b = {.params = params, .step_mm = params->step_mm};
  size_t most = params->n_zooms && params->n < TC_ZOOM_NODES ? TC_ZOOM_NODES : (size_t)params->n;
  b.first = calloc(most + 1, sizeof *b.first);
  b.scratch = aligned_alloc(16, (size_t)tc_pool_threads(pool) * 4 * most * sizeof(v4));
  bool ok = t && b.first && b.scratch && build_window(&b, pool, (tc_zoom){t->lo, t->hi}, t->n, t->zero_row);
  for (int i = 0; ok && i < t->n_zooms; i++) ok = build_window(&b, pool, t->zooms[i], TC_ZOOM_NODES, t->zoom_rows[i]);
  if (ok) {
    for (size_t i = 0; params->bits && i < t->bytes / sizeof(float); i++)
      if (t->entries[i] != 0) t->entries[i] = tc_table_round(t->entries[i], params->bits);
    t->build_ms = tc_now_ms() - start;
  } else {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "pre-integration table of %d values a side: out of memory", params->n);
    tc_table_free(t);
    t = NULL;
  }
  free(b.pieces);
  free(b.first);
  free(b.scratch);
  return t;
}
