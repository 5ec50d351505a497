/* See segments.h. */
#include "renderer/classify/segments.h"
#include "renderer/classify/transfer.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Part of a node interval with linear colour and (nearly) linear extinction. */
struct tc_piece {
  float width; /* share of the node interval */
  uint32_t graded; /* 1: the colour changes along it; uint32_t because pieces are compared as bytes: no padding */
  double mean; /* exact mean of the extinction, 1/mm */
  double tilt; /* extinction = mean * (1 + tilt * (2u - 1)), |tilt| <= 1 */
  double from[3], to[3]; /* colour, compositing space */
};

/* Four node intervals of one piece each, in SIMD layout, for segments so short that a series suffices. */
struct tc_quad {
  tc_v4 depth, tilt; /* depth: extinction */
  tc_i4 graded;      /* all bits or none */
  tc_v4 from[4], to[4]; /* colour, with 1 for opacity */
  float longest_mm;     /* longest segment for which the series is accurate; 0 if one of the four has a knot inside */
};

#define MOST_DEPTH 1e30 /* sums stay finite */

/* ---- pieces ---- */

double tc_segments_value(const tc_segments *s, int node) {
  return s->params->slope * (s->lo + (s->hi - s->lo) * node / (s->count - 1)) + s->params->intercept;
}

void tc_segments_color(const tc_table_params *p, double value, double rgb[3]) {
  tc_color(p->tf, value, rgb);
  if (p->linear_light)
    for (int c = 0; c < 3; c++) rgb[c] = tc_srgb_to_linear(rgb[c]);
}

static void make_piece(const tc_segments *s, double width, double v0, double v1, tc_piece *q) {
  /* One-sided limits: there may be a jump at either end, so the colours are taken slightly inside. */
  double in0 = v0 + (v1 - v0) * 1e-9, in1 = v1 - (v1 - v0) * 1e-9;
  q->width = (float)width;
  q->mean = tc_extinction_mean(s->params->tf, v0, v1);
  double tau0 = tc_extinction(s->params->tf, in0), tau1 = tc_extinction(s->params->tf, in1);
  q->tilt = q->mean > 0 ? fmin(fmax((tau1 - tau0) / (2 * q->mean), -1), 1) : 0;
  tc_segments_color(s->params, in0, q->from);
  tc_segments_color(s->params, in1, q->to);
  if (s->params->linear_light) { /* shifts both ends so that the line has the mean of the curve (Simpson's rule) */
    double middle[3];
    tc_segments_color(s->params, 0.5 * (v0 + v1), middle);
    for (int c = 0; c < 3; c++) {
      double more = (middle[c] - 0.5 * (q->from[c] + q->to[c])) * (2.0 / 3);
      q->from[c] = fmax(q->from[c] + more, 0);
      q->to[c] = fmax(q->to[c] + more, 0);
    }
  }
  q->graded = fabs(q->to[0] - q->from[0]) + fabs(q->to[1] - q->from[1]) + fabs(q->to[2] - q->from[2]) > 1e-7;
}

static bool add_piece(tc_segments *s, double width, double v0, double v1) {
  if (s->n_pieces == s->capacity) {
    uint32_t capacity = s->capacity ? 2 * s->capacity : 1024;
    tc_piece *grown = realloc(s->pieces, capacity * sizeof *grown);
    if (!grown) return false;
    s->pieces = grown;
    s->capacity = capacity;
  }
  make_piece(s, width, v0, v1, &s->pieces[s->n_pieces++]);
  return true;
}

#define ERROR 5e-7 /* error of a piece's colour from linear colour and extinction */
#define MOST_PARTS 512
#define MOST_PIECES (1 << 17) /* per axis, roughly: each diagonal of a table reads all of them */

/* Bound on the colour error of a piece that is treated as linear: `error` for an opaque piece. A piece of optical depth
 * D < 1 has exact means and is visible throughout, so its error is error * D * max(D, uneven), where `uneven` is the
 * relative change of extinction. */
typedef struct error_bound {
  double error, uneven;
} error_bound;

/* In linear light, colour is a curve between two knots. */
static error_bound curve_error(const tc_segments *s, double v0, double v1) {
  double from[3], middle[3], to[3], bend = 0, inside = (v1 - v0) * 1e-9;
  if (!s->params->linear_light) return (error_bound){0, 0};
  tc_segments_color(s->params, v0 + inside, from);
  tc_segments_color(s->params, 0.5 * (v0 + v1), middle);
  tc_segments_color(s->params, v1 - inside, to);
  for (int c = 0; c < 3; c++) bend = fmax(bend, fabs(middle[c] - 0.5 * (from[c] + to[c])));
  return (error_bound){bend, 0};
}

/* Between opacity knots, transparency is linear in the value and extinction its logarithm. Replacing that curve by a
 * line matters only where the colour changes too: the error is about the product of both changes along a piece.
 * Pieces at equal steps of the square root of transparency all have the same product. */
static error_bound bend_error(const tc_segments *s, double v0, double v1, double roots[2]) {
  const tc_transfer_function *tf = s->params->tf;
  double from[3], to[3], change = 0, inside = (v1 - v0) * 1e-9;
  if (tf->kind != TC_KNOT_OPACITY) return (error_bound){0, 0};
  tc_color(tf, v0 + inside, from);
  tc_color(tf, v1 - inside, to);
  for (int c = 0; c < 3; c++) change = fmax(change, fabs(to[c] - from[c]));
  roots[0] = exp(-0.5 * tc_extinction(tf, v0 + inside) * tf->unit_distance_mm);
  roots[1] = exp(-0.5 * tc_extinction(tf, v1 - inside) * tf->unit_distance_mm);
  double bend = fabs(roots[0] - roots[1]) / (roots[0] + roots[1]);
  return (error_bound){0.12 * change * bend, bend};
}

/* Number of parts that keep the error below ERROR; the error falls with the square of their number. */
static int parts_for(const tc_segments *s, error_bound d, double width, double v0, double v1, int most) {
  if (d.error <= ERROR) return 1;
  double depth = tc_extinction_mean(s->params->tf, v0, v1) * width * s->params->step_mm;
  return (int)fmax(fmin(ceil(sqrt(d.error * fmin(depth * fmax(depth, d.uneven), 1) / ERROR)), most), 1);
}

/* The optical depth up to which one part suffices. */
static double depth_for_one_part(error_bound d) {
  double most = ERROR / d.error;
  return d.error <= ERROR ? INFINITY : d.uneven * d.uneven > most ? most / d.uneven : sqrt(most);
}

static bool add_curved(tc_segments *s, double width, double v0, double v1, int most) {
  int parts = parts_for(s, curve_error(s, v0, v1), width, v0, v1, most);
  for (int i = 0; i < parts; i++)
    if (!add_piece(s, width / parts, v0 + (v1 - v0) * i / parts, v0 + (v1 - v0) * (i + 1) / parts)) return false;
  return true;
}

static bool add_bent(tc_segments *s, double width, double v0, double v1) {
  double roots[2], from = 0;
  int parts = parts_for(s, bend_error(s, v0, v1, roots), width, v0, v1, s->most_parts);
  int each = s->most_parts / parts; /* at least 1 */
  for (int i = 1; i < parts; i++) {
    double r0 = roots[0], r1 = roots[1], r = r0 + (r1 - r0) * i / parts;
    double to = (r0 - r) * (r0 + r) / ((r0 - r1) * (r0 + r1));
    if (!add_curved(s, width * (to - from), v0 + (v1 - v0) * from, v0 + (v1 - v0) * to, each)) return false;
    from = to;
  }
  return add_curved(s, width * (1 - from), v0 + (v1 - v0) * from, v1, each);
}

/* A node interval with more than MOST_KNOTS knots becomes a few pieces, each with the exact mean extinction and the
 * mean emitted colour. Look-ups cannot resolve details between nodes anyway, and the build time stays bounded. */
enum { MOST_KNOTS = 8, MERGED_PIECES = 4 };

/* Adds emission and extinction between two values without a knot inside. Two Gauss points are exact where both
 * factors are linear. */
static void add_emission(const tc_segments *s, double v0, double v1, double sum[4]) {
  static const double places[2] = {0.21132486540518712, 0.78867513459481288};
  for (int i = 0; i < 2; i++) {
    double v = v0 + (v1 - v0) * places[i], tau = fabs(v1 - v0) * tc_extinction(s->params->tf, v), rgb[3];
    tc_segments_color(s->params, v, rgb);
    for (int c = 0; c < 3; c++) sum[c] += tau * rgb[c];
    sum[3] += tau;
  }
}

static bool is_halted(tc_segments *s) { return s->left = tc_halt_within(s->halt); }

#define POLL 256 /* knots between two polls of the halt */

static bool merge_pieces(tc_segments *s, double v0, double v1) {
  for (int i = 0; i < MERGED_PIECES; i++) {
    double from = v0 + (v1 - v0) * i / MERGED_PIECES, to = v0 + (v1 - v0) * (i + 1) / MERGED_PIECES, sum[4] = {0};
    if (!add_piece(s, 1.0 / MERGED_PIECES, from, to)) return false;
    for (size_t at = 0; from != to;) {
      double next = tc_next_knot(s->params->tf, from, to, &at);
      add_emission(s, from, next, sum);
      from = next;
      if (at % POLL == POLL - 1 && is_halted(s)) return false;
    }
    tc_piece *q = &s->pieces[s->n_pieces - 1];
    if (sum[3] > 0)
      for (int c = 0; c < 3; c++) q->from[c] = q->to[c] = sum[c] / sum[3];
    q->graded = false;
  }
  return true;
}

#define SERIES_DEPTH 0.5 /* largest optical depth for which elementary_four() is accurate to single precision */

/* Interval j as one piece, for segments so short that one piece suffices; marks the quad unusable if there is a knot
 * inside. */
static void fill_quad(tc_segments *s, int j, bool knots_inside, double v0, double v1) {
  tc_quad *q = &s->quads[j / 4];
  int k = j % 4;
  tc_piece p;
  double roots[2], longest = INFINITY;
  if (knots_inside) {
    q->longest_mm = 0;
    return;
  }
  make_piece(s, 1, v0, v1, &p);
  double depth = fmin(p.mean, MOST_DEPTH);
  q->depth[k] = (float)depth;
  q->tilt[k] = (float)p.tilt;
  q->graded[k] = -p.graded;
  for (int c = 0; c < 4; c++) {
    q->from[k][c] = c < 3 ? (float)p.from[c] : 1;
    q->to[k][c] = c == 3 ? 1 : p.graded ? (float)p.to[c] : q->from[k][c];
  }
  if (p.graded && depth > 0) {
    double most = fmin(depth_for_one_part(bend_error(s, v0, v1, roots)), depth_for_one_part(curve_error(s, v0, v1)));
    longest = fmin(most, fmin(SERIES_DEPTH, 0.05 / fabs(p.tilt))) / depth;
  }
  q->longest_mm = fminf(q->longest_mm, (float)longest);
}

/* Cuts node interval j into pieces; s->params->tf: the knots near it. */
static bool cut_interval(tc_segments *s, int j) {
  const tc_transfer_function *tf = s->params->tf;
  const double v0 = tc_segments_value(s, j), v1 = tc_segments_value(s, j + 1);
  const bool rising = s->params->slope > 0;
  int knots = 0;
  for (size_t i = 0; i < tf->count; i++) {
    const double k = tf->points[i].value;
    knots += rising ? k > v0 && k < v1 : k < v0 && k > v1;
  }
  if (j / 4 < s->count / 4) fill_quad(s, j, knots > 0, v0, v1);
  if (knots > MOST_KNOTS) return merge_pieces(s, v0, v1);
  size_t at = 0;
  double from = v0;
  do { /* runs once if the axis is so short that v0 = v1 */
    double next = tc_next_knot(tf, from, v1, &at);
    if (!add_bent(s, (next - from) / (v1 - v0), from, next)) return false;
    from = next;
  } while (from != v1);
  return true;
}

static bool cut_into_pieces(tc_segments *s) {
  const tc_table_params *params = s->params;
  tc_table_params about = *params;
  bool ok = true;
  s->params = &about;
  for (int j = 0; ok && j < s->count; j++) {
    const tc_transfer_function near =
        tc_knots_between(params->tf, tc_segments_value(s, j), tc_segments_value(s, j + 1));
    about.tf = &near;
    s->first[j] = s->n_pieces;
    ok = (j % 4 || !is_halted(s)) && cut_interval(s, j);
  }
  s->first[s->count] = s->n_pieces;
  s->params = params;
  return ok;
}

/* ---- elementary segments ---- */

/* Integral over u in [0,1] of exp(-a u - a b u (u - 1)), for tilt b (ahead) and -b (behind: seen from the other
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

/* Colour and opacity seen from the end with colour `near`. w: opacity; q: share of the light from the far end (the
 * integral of u dW). */
static tc_v4 emit(double w, double q, const double near[3], const double far[3]) {
  q = fmin(fmax(q, 0), w);
  return (tc_v4){(float)(near[0] * (w - q) + far[0] * q), (float)(near[1] * (w - q) + far[1] * q),
              (float)(near[2] * (w - q) + far[2] * q), (float)w};
}

/* A piece whose colour changes, cut into parts whose a * b is small; parts behind opacity 1 are skipped. */
static tc_v4 cut_piece(const tc_piece *p, double a, bool reverse, int parts) {
  const double *from = reverse ? p->to : p->from, *to = reverse ? p->from : p->to;
  double tilt = reverse ? -p->tilt : p->tilt;
  tc_product all = {{0}, {0}};
  for (int i = 0; i < parts && all.sum[3] < 1 - 1e-7f; i++) {
    double u0 = (double)i / parts, u1 = (double)(i + 1) / parts, c0[3], c1[3];
    double mean = 1 + tilt * (u0 + u1 - 1); /* relative extinction of this part; 0 at a tip with |tilt| = 1 */
    for (int c = 0; c < 3; c++) {
      c0[c] = from[c] + u0 * (to[c] - from[c]);
      c1[c] = from[c] + u1 * (to[c] - from[c]);
    }
    double bent = mean > 0 ? fmin(fmax(tilt / parts / mean, -1), 1) : 0, part = a * mean / parts, w = -expm1(-part);
    tc_put_behind(&all, emit(w, decay_integral(part, bent, 1 - w).ahead - (1 - w), c0, c1));
  }
  return all.sum;
}

static void graded_piece(const tc_piece *p, double a, tc_v4 *forward, tc_v4 *backward) {
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

static tc_v4 flat_piece(const tc_piece *p, double a) {
  double w = -expm1(-a);
  return (tc_v4){(float)(p->from[0] * w), (float)(p->from[1] * w), (float)(p->from[2] * w), (float)w};
}

/* Node interval j as one segment of length `length_mm`, in both directions. */
static void elementary(const tc_segments *s, int j, double length_mm, tc_v4 *forward, tc_v4 *backward) {
  tc_product f = {{0}, {0}}, r = {{0}, {0}};
  for (uint32_t i = s->first[j]; i < s->first[j + 1]; i++) {
    const tc_piece *p = &s->pieces[i];
    double a = p->mean * (double)p->width * length_mm;
    if (!(a > 0)) continue;
    tc_v4 pf, pr;
    if (p->graded)
      graded_piece(p, a, &pf, &pr);
    else
      pf = pr = flat_piece(p, a);
    tc_put_behind(&f, pf);
    tc_put_before(&r, pr);
  }
  *forward = f.sum;
  *backward = r.sum;
}

/* ---- elementary segments, four at a time: most are thin and of one piece ---- */

/* 1 - exp(-a), a >= 0, with a small relative error even for small a. */
static tc_v4 one_minus_exp(tc_v4 a) {
  a = tc_v4_lesser(a, (tc_v4){87, 87, 87, 87});
  tc_v4 shift = a * -1.44269504f + 12582912.0f, n = shift - 12582912.0f; /* rounds to an integer */
  tc_v4 f = (-a - n * 0.693359375f) + n * 2.12194440e-4f, p = f * (1.0f / 720 + f * (1.0f / 5040));
  p = f * (1 + f * (0.5f + f * (1.0f / 6 + f * (1.0f / 24 + f * (1.0f / 120 + p)))));
  tc_v4 scale = (tc_v4)(((tc_i4)shift - 0x4b400000 + 127) << 23);
  return -(scale * p) - (scale - 1);
}

/* elementary() for four intervals, and a length of at most longest_mm. The series are decay_integral()'s with the
 * opacity already subtracted from i0, so that nothing cancels. */
static void elementary_four(const tc_quad *q, float length_mm, tc_v4 forward[4], tc_v4 backward[4]) {
  tc_v4 a = q->depth * length_mm, w = one_minus_exp(a), x = a * q->tilt;
  tc_v4 mean = a * (1.0f / 144 - a * (1.0f / 840 - a * (1.0f / 5760 - a * (1.0f / 45360))));
  mean = a * (0.5f - a * (1.0f / 3 - a * (1.0f / 8 - a * (1.0f / 30 - mean))));
  tc_v4 i1 = 1.0f / 40 - a * (1.0f / 180 - a * (1.0f / 1008 - a * (1.0f / 6720)));
  i1 = 1.0f / 6 - a * (1.0f / 12 - a * i1);
  tc_v4 i2 = 1.0f / 30 - a * (1.0f / 60 - a * (1.0f / 210 - a * (1.0f / 1008)));
  tc_v4 even = mean + 0.5f * x * x * i2, odd = x * i1;
  /* The series may be NaN for a deep segment, but then the colour is constant and the mask removes it. */
  tc_v4 ahead = (tc_v4)((tc_i4)tc_v4_lesser(even + odd, w) & q->graded);
  tc_v4 behind = (tc_v4)((tc_i4)tc_v4_lesser(even - odd, w) & q->graded);
  for (int k = 0; k < 4; k++) {
    forward[k] = q->from[k] * (w[k] - ahead[k]) + q->to[k] * ahead[k];
    backward[k] = q->to[k] * (w[k] - behind[k]) + q->from[k] * behind[k];
  }
}

void tc_segments_integrate(const tc_segments *s, double length_mm, int from, int to, tc_v4 *forward, tc_v4 *backward) {
  int j = from & ~3; /* whole quads: the result for an interval does not depend on the requested range */
  for (; j < to && j + 4 <= s->count; j += 4)
    if ((float)length_mm <= s->quads[j / 4].longest_mm)
      elementary_four(&s->quads[j / 4], (float)length_mm, forward + j, backward + j);
    else
      for (int k = 0; k < 4; k++) elementary(s, j + k, length_mm, &forward[j + k], &backward[j + k]);
  for (; j < to; j++) elementary(s, j, length_mm, &forward[j], &backward[j]);
}

void tc_segments_depths(const tc_segments *s, double length_mm, tc_v4 *depths) {
  double sum = 0;
  for (int j = 0; j <= s->count; j++) {
    double mean = 0, tilt = 0;
    if (j < s->count) {
      const tc_piece *first = &s->pieces[s->first[j]], *last = &s->pieces[s->first[j + 1] - 1];
      for (const tc_piece *p = first; p <= last; p++) mean += p->mean * (double)p->width;
      tilt = 0.5 * (last->mean * (1 + last->tilt) - first->mean * (1 - first->tilt));
      mean = fmin(mean * length_mm, MOST_DEPTH);
      tilt = fmin(fmax(tilt * length_mm, -mean), mean);
    }
    float high = (float)sum;
    depths[j] = (tc_v4){high, (float)(sum - (double)high), (float)(mean - tilt), (float)(mean + tilt)};
    sum += mean;
  }
}

void tc_segments_ends(const tc_segments *s, double length_mm, float (*ends)[8]) {
  for (uint32_t i = 0; i < s->n_pieces; i++) {
    const tc_piece *p = &s->pieces[i];
    double depth = p->mean * (double)p->width * length_mm; /* each end separately, so that a thin piece keeps its
                                                              precision */
    for (int c = 0; c < 3; c++) {
      ends[i][c] = (float)p->from[c];
      ends[i][4 + c] = (float)(p->graded ? p->to[c] : p->from[c]);
    }
    ends[i][3] = (float)fmin(depth * (1 - p->tilt), MOST_DEPTH);
    ends[i][7] = (float)fmin(depth * (1 + p->tilt), MOST_DEPTH);
  }
}

/* ---- making and freeing ---- */

bool tc_segments_make(tc_segments *s, const tc_table_params *params, const double range[2], int count,
                      const tc_halt *halt, GError **error) {
  const size_t stretches = (size_t)count + params->tf->count, quads = (size_t)count / 4 + 1;
  *s = (tc_segments){.params = params, .lo = range[0], .hi = range[1], .count = count, .halt = halt};
  s->most_parts = (int)fmin(fmax(MOST_PIECES / (double)stretches, 1), MOST_PARTS);
  s->first = calloc((size_t)count + 1, sizeof *s->first);
  s->quads = aligned_alloc(16, quads * sizeof *s->quads);
  for (size_t i = 0; s->quads && i < quads; i++) s->quads[i].longest_mm = INFINITY;
  if (!s->first || !s->quads || !cut_into_pieces(s)) {
    if (s->left) return tc_halt_say(halt, error);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "pre-integration table of %d values a side: out of memory", count);
    return false;
  }
  tc_piece *fitting = realloc(s->pieces, s->n_pieces * sizeof *fitting);
  if (fitting) s->pieces = fitting, s->capacity = s->n_pieces;
  return true;
}

void tc_segments_finish(tc_segments *s) {
  free(s->pieces);
  free(s->first);
  free(s->quads);
  *s = (tc_segments){0};
}

size_t tc_segments_bytes(const tc_segments *s) {
  return s->capacity * sizeof *s->pieces + (size_t)s->count * (sizeof *s->first + sizeof *s->quads / 4);
}

static bool same_interval(const tc_segments *a, const tc_segments *b, int j) {
  uint32_t n = a->first[j + 1] - a->first[j];
  return n == b->first[j + 1] - b->first[j] &&
         !memcmp(a->pieces + a->first[j], b->pieces + b->first[j], n * sizeof *a->pieces);
}

bool tc_segments_compare(const tc_segments *a, const tc_segments *b, int *first, int *last) {
  int from = 0, to = a->count - 1;
  while (from <= to && same_interval(a, b, from)) from++;
  while (to > from && same_interval(a, b, to)) to--;
  *first = from & ~3;
  *last = (to | 3) < a->count ? to | 3 : a->count - 1;
  return from <= to;
}
