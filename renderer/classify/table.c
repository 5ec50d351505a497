/* The full pre-integration table in O(n^2) (NUMERICS section 3).
 *
 * Entry (i, k) is the composite of the k elementary segments i .. i+k-1, each of length d/k. A segment is (R, G, B, alpha)
 * and two of them compose with "over", which is associative, so the entries of one diagonal k are products over sliding
 * windows of width k: block suffix times block prefix (van Herk, Gil-Werman) gives each in a constant number of
 * compositions, with no subtraction and hence no cancellation however stiff the extinction is.
 *
 * What single precision leaves: entries hold opacity, not depth, and from an optical depth of 16.7 a segment on 1 - opacity
 * is 0. Only the last, shorter segment of a ray asks for the depth back, and takes it for 69 then (a transparency of
 * 1e-30): over a share s of a segment of depth D >= 16.7 its transparency is off by |exp(-D s) - exp(-69 s)|. For D up to 69
 * that is at most 0.48 (D = 16.7, s = 0.03) and under 0.01 from s = 0.28 on; beyond, at most exp(-69 s), under 0.01 from
 * s = 0.07 on. It stays within 0..1. */
#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "renderer/classify/classify.h"
#include "renderer/clock.h"

typedef float v4 __attribute__((vector_size(16)));
typedef int32_t i4 __attribute__((vector_size(16)));

/* A stretch of the value axis inside one node interval with linear colour and (nearly) linear extinction. */
typedef struct piece {
  float width; /* share of the node interval */
  bool graded; /* colour changes along it */
  double mean; /* of the extinction, 1/mm, exact */
  double tilt; /* extinction = mean * (1 + tilt * (2u - 1)), |tilt| <= 1 */
  double from[3], to[3]; /* colour, compositing space */
} piece;

/* Four node intervals of one piece each, side by side, for segments short enough that a series serves them. */
typedef struct quad {
  v4 depth, tilt;    /* extinction times share of the interval */
  i4 graded;         /* all bits or none */
  v4 from[4], to[4];      /* colour, with 1 for opacity */
  float longest_mm;       /* of an interval; 0 where not all four have one piece */
} quad;

typedef struct builder {
  const tc_table_params *params;
  double lo, hi; /* of the table or zoom at hand */
  double step_mm;
  int columns;
  float *zero_row;
  piece *pieces;
  uint32_t *first; /* [intervals + 1] into pieces */
  uint32_t count, capacity;
  quad *quads; /* [intervals / 4] */
  v4 peak;     /* the brightest of each colour, and 1 */
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

/* ---- elementary segments, four at a time: most are one piece and thin ---- */

#define SERIES_DEPTH 0.5 /* what the series below are good for, to single precision */

static void fill_quads(builder *b) {
  for (int i = 0; i < b->intervals / 4; i++) {
    quad *q = &b->quads[i];
    double longest = INFINITY;
    for (int k = 0; k < 4; k++) {
      int j = 4 * i + k;
      const piece *p = &b->pieces[b->first[j]];
      double depth = fmin(p->mean * (double)p->width, 1e30);
      q->depth[k] = (float)depth;
      q->tilt[k] = (float)p->tilt;
      q->graded[k] = -p->graded;
      for (int c = 0; c < 4; c++) {
        q->from[k][c] = c < 3 ? (float)p->from[c] : 1;
        q->to[k][c] = c == 3 ? 1 : p->graded ? (float)p->to[c] : q->from[k][c];
      }
      if (b->first[j + 1] - b->first[j] != 1) longest = 0;
      if (p->graded && depth > 0) longest = fmin(longest, fmin(SERIES_DEPTH, 0.05 / fabs(p->tilt)) / depth);
    }
    q->longest_mm = (float)longest;
  }
}

static v4 lesser(v4 a, v4 b) {
  i4 less = a < b;
  return (v4)((less & (i4)a) | (~less & (i4)b));
}

/* 1 - exp(-a), a >= 0, with small relative error for small a too. */
static v4 one_minus_exp(v4 a) {
  a = lesser(a, (v4){87, 87, 87, 87});
  v4 shift = a * -1.44269504f + 12582912.0f, n = shift - 12582912.0f; /* rounds to an integer */
  v4 f = (-a - n * 0.693359375f) + n * 2.12194440e-4f, p = f * (1.0f / 720 + f * (1.0f / 5040));
  p = f * (1 + f * (0.5f + f * (1.0f / 6 + f * (1.0f / 24 + f * (1.0f / 120 + p)))));
  v4 scale = (v4)(((i4)shift - 0x4b400000 + 127) << 23);
  return -(scale * p) - (scale - 1);
}

/* As elementary(), for a length of at most longest_mm. The series are decay_integral()'s, with the opacity already taken
 * off i0: nothing cancels. */
static void elementary_four(const quad *q, float length_mm, v4 forward[4], v4 backward[4]) {
  v4 a = q->depth * length_mm, w = one_minus_exp(a), x = a * q->tilt;
  v4 mean = a * (1.0f / 144 - a * (1.0f / 840 - a * (1.0f / 5760 - a * (1.0f / 45360))));
  mean = a * (0.5f - a * (1.0f / 3 - a * (1.0f / 8 - a * (1.0f / 30 - mean))));
  v4 i1 = 1.0f / 40 - a * (1.0f / 180 - a * (1.0f / 1008 - a * (1.0f / 6720)));
  i1 = 1.0f / 6 - a * (1.0f / 12 - a * i1);
  v4 i2 = 1.0f / 30 - a * (1.0f / 60 - a * (1.0f / 210 - a * (1.0f / 1008)));
  v4 even = mean + 0.5f * x * x * i2, odd = x * i1;
  /* A deep series may be no number, but then no colour changes and the mask takes it away. */
  v4 ahead = (v4)((i4)lesser(even + odd, w) & q->graded), behind = (v4)((i4)lesser(even - odd, w) & q->graded);
  for (int k = 0; k < 4; k++) {
    forward[k] = q->from[k] * (w[k] - ahead[k]) + q->to[k] * ahead[k];
    backward[k] = q->to[k] * (w[k] - behind[k]) + q->from[k] * behind[k];
  }
}

static void elementary_all(const builder *b, double length_mm, v4 *forward, v4 *backward) {
  int j = 0;
  for (; j + 4 <= b->intervals; j += 4)
    if ((float)length_mm <= b->quads[j / 4].longest_mm)
      elementary_four(&b->quads[j / 4], (float)length_mm, forward + j, backward + j);
    else
      for (int k = 0; k < 4; k++) elementary(b, j + k, length_mm, &forward[j + k], &backward[j + k]);
  for (; j < b->intervals; j++) elementary(b, j, length_mm, &forward[j], &backward[j]);
}

/* ---- diagonals ---- */

/* Light sums and opacity round apart: what shines is held to the opacity times the brightest there is, to the last bit. */
static v4 held(v4 entry, v4 peak) {
  v4 most = entry[3] * peak;
  return lesser(entry, most);
}

static void diagonal_zero(builder *b) {
  v4 *row = (v4 *)b->zero_row;
  for (int i = 0; i <= b->intervals; i++) {
    double v = node_value(b, i), w = -expm1(-tc_extinction(b->params->tf, v) * b->step_mm), rgb[3];
    color_in(b->params, v, rgb);
    row[i] = held((v4){(float)(rgb[0] * w), (float)(rgb[1] * w), (float)(rgb[2] * w), (float)w}, b->peak);
  }
}

/* Windows of width k over m elementary segments, towards higher nodes (out_f) and towards lower ones (out_b). */
static void sliding_windows(const v4 *ef, const v4 *eb, v4 *sf, v4 *sb, int m, int k, v4 peak, v4 *out_f, v4 *out_b) {
  for (int start = 0; start + k <= m; start += k) {
    v4 f = ef[start + k - 1], r = eb[start + k - 1];
    sf[k - 1] = f, sb[k - 1] = r;
    for (int j = k - 2; j >= 0; j--) {
      sf[j] = f = over(ef[start + j], f);
      sb[j] = r = over(r, eb[start + j]);
    }
    out_f[start] = held(f, peak), out_b[start] = held(r, peak);
    if (start + k >= m) break;
    v4 pf = ef[start + k], pb = eb[start + k];
    for (int j = 1; j < k && start + j + k <= m; j++) {
      if (j > 1) {
        pf = over(pf, ef[start + k + j - 1]);
        pb = over(eb[start + k + j - 1], pb);
      }
      out_f[start + j] = held(over(sf[j], pf), peak);
      out_b[start + j] = held(over(pb, sb[j]), peak);
    }
  }
}

static void build_diagonal(void *context, int index, int worker) {
  builder *b = context;
  /* Long and short diagonals in turn, so that workers finish together. */
  int m = b->intervals, k = index % 2 ? m - index / 2 : 1 + index / 2;
  v4 *ef = b->scratch + (size_t)worker * 4 * (size_t)m, *eb = ef + m, *sf = eb + m, *sb = sf + m;
  elementary_all(b, b->step_mm / k, ef, eb);
  ptrdiff_t stride = b->columns;
  v4 *zero = (v4 *)b->zero_row;
  sliding_windows(ef, eb, sf, sb, m, k, b->peak, zero + k * stride, zero - k * stride);
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

static v4 brightest(const tc_table_params *p) {
  v4 peak = {0, 0, 0, 1};
  for (size_t i = 0; i < p->tf->count; i++) {
    double rgb[3];
    memcpy(rgb, p->tf->points[i].color, sizeof rgb);
    for (int c = 0; c < 3; c++) peak[c] = fmaxf(peak[c], (float)(p->linear_light ? tc_srgb_to_linear(rgb[c]) : rgb[c]));
  }
  return peak;
}

/* The table itself, or one of its zooms. */
static bool build_window(builder *b, tc_pool *pool, tc_zoom window, int n, float *zero_row) {
  b->lo = window.lo, b->hi = window.hi;
  b->intervals = n;
  b->columns = n + 2;
  b->zero_row = zero_row;
  b->count = 0;
  if (!cut_into_pieces(b)) return false;
  fill_quads(b);
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
  b.quads = aligned_alloc(16, (most / 4 + 1) * sizeof *b.quads);
  b.peak = brightest(params);
  b.scratch = aligned_alloc(16, (size_t)tc_pool_threads(pool) * 4 * most * sizeof(v4));
  bool ok = t && b.first && b.quads && b.scratch && build_window(&b, pool, (tc_zoom){t->lo, t->hi}, t->n, t->zero_row);
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
  free(b.quads);
  free(b.scratch);
  return t;
}
