/* A transfer function at a point and averaged over an interval (NUMERICS sections 0 and 2). */
#include "renderer/classify/transfer.h"

#include <math.h>

#include "renderer/classify/segments.h"

/* Opacity 1 has no finite extinction; this is the largest that float accumulators can tell from 1. */
static double clamp_opacity(double a) { return fmin(fmax(a, 0), 1 - 0x1p-24); }

double tc_srgb_to_linear(double c) { return c <= 0.04045 ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4); }
double tc_linear_to_srgb(double c) { return c <= 0.0031308 ? c * 12.92 : 1.055 * pow(c, 1 / 2.4) - 0.055; }

/* Index of the last knot with value <= v (at a jump, the upper knot); -1 before the first. */
static ptrdiff_t knot_below(const tc_transfer_function *tf, double v) {
  ptrdiff_t lo = -1, hi = (ptrdiff_t)tf->count;
  while (hi - lo > 1) {
    ptrdiff_t mid = lo + (hi - lo) / 2;
    if (tf->points[mid].value <= v)
      lo = mid;
    else
      hi = mid;
  }
  return lo;
}

tc_transfer_function tc_knots_between(const tc_transfer_function *tf, double a, double b) {
  /* One more knot on either side, for values that rounding puts outside [a, b]. */
  ptrdiff_t first = knot_below(tf, fmin(a, b)) - 1, last = knot_below(tf, fmax(a, b)) + 2;
  tc_transfer_function part = *tf;
  if (first < 0) first = 0;
  if (last > (ptrdiff_t)tf->count - 1) last = (ptrdiff_t)tf->count - 1;
  part.points += first;
  part.count = (size_t)(last - first + 1);
  return part;
}

double tc_next_knot(const tc_transfer_function *tf, double from, double to, size_t *at) {
  const bool rising = to > from;
  while (*at < tf->count) {
    const double knot = tf->points[rising ? *at : tf->count - 1 - *at].value;
    if (rising ? knot >= to : knot <= to) break;
    ++*at;
    if (rising ? knot > from : knot < from) return knot;
  }
  return to;
}

double tc_extinction(const tc_transfer_function *tf, double value) {
  ptrdiff_t i = knot_below(tf, value);
  double amount;
  if (i < 0) {
    amount = tf->points[0].amount;
  } else if (i + 1 >= (ptrdiff_t)tf->count) {
    amount = tf->points[tf->count - 1].amount;
  } else {
    const tc_knot *a = &tf->points[i], *b = a + 1;
    double u = (value - a->value) / (b->value - a->value);
    if (tf->kind == TC_KNOT_OPACITY) /* interpolates clamped opacities, as the interval means do */
      return -log1p(-(clamp_opacity(a->amount) + u * (clamp_opacity(b->amount) - clamp_opacity(a->amount)))) /
             tf->unit_distance_mm;
    return a->amount + u * (b->amount - a->amount);
  }
  return tf->kind == TC_KNOT_OPACITY ? -log1p(-clamp_opacity(amount)) / tf->unit_distance_mm : amount;
}

void tc_color(const tc_transfer_function *tf, double value, double rgb[3]) {
  ptrdiff_t i = knot_below(tf, value);
  const tc_knot *a = &tf->points[i < 0 ? 0 : i];
  const tc_knot *b = i < 0 || i + 1 >= (ptrdiff_t)tf->count ? a : a + 1;
  double u = a == b ? 0 : (value - a->value) / (b->value - a->value);
  for (int c = 0; c < 3; c++) rgb[c] = a->color[c] + u * (b->color[c] - a->color[c]);
}

double tc_extinction_most(const tc_transfer_function *tf) {
  double most = 0;
  for (size_t i = 0; i < tf->count; i++) most = fmax(most, tf->points[i].amount);
  return tf->kind == TC_KNOT_OPACITY ? -log1p(-clamp_opacity(most)) / tf->unit_distance_mm : most;
}

/* Mean of -ln(x) for x linear from x0 to x1: the antiderivative x - x ln x, written in r = (x1-x0)/x0 so that nothing
 * cancels. */
static double mean_minus_log(double x0, double x1) {
  double r = (x1 - x0) / x0, tail;
  if (fabs(r) < 1e-2) /* (1+r) ln(1+r)/r - 1 as a series; next term r^6/42 */
    tail = r * (1.0 / 2 - r * (1.0 / 6 - r * (1.0 / 12 - r * (1.0 / 20 - r / 30))));
  else
    tail = (1 + r) * log1p(r) / r - 1;
  return -log(x0) - tail;
}

/* Mean over [a, b] inside one knot interval (or beyond the ends). */
static double piece_mean(const tc_transfer_function *tf, ptrdiff_t below, double a, double b) {
  if (below < 0 || below + 1 >= (ptrdiff_t)tf->count) return tc_extinction(tf, below < 0 ? a : b);
  const tc_knot *p = &tf->points[below], *q = p + 1;
  double width = q->value - p->value, ua = (a - p->value) / width, ub = (b - p->value) / width;
  if (tf->kind == TC_KNOT_EXTINCTION) return p->amount + 0.5 * (ua + ub) * (q->amount - p->amount);
  double pa = clamp_opacity(p->amount), pb = clamp_opacity(q->amount);
  return mean_minus_log(1 - (pa + ua * (pb - pa)), 1 - (pa + ub * (pb - pa))) / tf->unit_distance_mm;
}

double tc_extinction_mean(const tc_transfer_function *tf, double a, double b) {
  if (a > b) {
    double swap = a;
    a = b, b = swap;
  }
  if (!(b > a)) return tc_extinction(tf, a);
  double sum = 0, from = a;
  ptrdiff_t below = knot_below(tf, a);
  while (from < b) {
    double to = below + 1 < (ptrdiff_t)tf->count ? fmin(tf->points[below + 1].value, b) : b;
    if (to > from) sum += (to - from) * piece_mean(tf, below, from, to);
    from = to;
    below++;
  }
  return sum / (b - a);
}
