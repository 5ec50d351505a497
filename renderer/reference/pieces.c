/* Cuts a cell's cubic into monotone pieces that meet no break of the transfer function. */
#include <float.h>
#include <math.h>

#include "renderer/reference/internal.h"

/* Real roots of c1 + 2 c2 u + 3 c3 u^2 inside (0, 1), ascending; the form that adds numbers of one sign. */
static int extrema(const double c[4], double roots[2]) {
  double a = 3 * c[3], b = c[2], k = c[1], disc = b * b - a * k, r[2];
  int found = 0, n = 0;
  if (a == 0) {
    if (b != 0) r[found++] = -k / (2 * b);
  } else if (disc >= 0) {
    double q = -(b + copysign(sqrt(disc), b));
    r[found++] = q / a;
    if (q != 0) r[found++] = k / q;
  }
  for (int i = 0; i < found; i++)
    if (r[i] > 0 && r[i] < 1) roots[n++] = r[i];
  if (n == 2 && roots[0] > roots[1]) {
    double swap = roots[0];
    roots[0] = roots[1], roots[1] = swap;
  }
  return n;
}

void tc_ref_cutter_start(tc_ref_cutter *cutter, const tc_ref_cell *cell, const double *breaks, size_t n_breaks) {
  *cutter = (tc_ref_cutter){.cell = cell, .breaks = breaks, .n_breaks = n_breaks, .mm = cell->length, .fresh = true};
  for (int i = 0; i < 4; i++)
    cutter->c[i] = cell->c[i];
  cutter->n_bends = extrema(cell->c, cutter->bend);
  cutter->bend[cutter->n_bends++] = 1;
}

static double rise(const double d[3], double x) { return x * (d[0] + x * (d[1] + x * d[2])); }

/* x in (0, width) with rise(x) = want, where rise is monotone and passes want: Newton held inside a shrinking bracket.
 */
static double solve(const double d[3], double width, double want) {
  double lo = 0, hi = width, sign = rise(d, width) >= 0 ? 1 : -1;
  double x = width * fmin(fmax(want / rise(d, width), 0), 1);
  for (int i = 0; i < 200; i++) {
    double f = sign * (rise(d, x) - want), slope = sign * (d[0] + x * (2 * d[1] + x * 3 * d[2]));
    if (f == 0) return x;
    if (f > 0)
      hi = x;
    else
      lo = x;
    double next = x - f / slope;
    if (!(next > lo && next < hi)) next = lo + 0.5 * (hi - lo);
    if (fabs(next - x) <= DBL_EPSILON * x || !(next > lo && next < hi)) return next;
    x = next;
  }
  return x;
}

/* Next break strictly between a and b in their order; false when there is none. */
static bool next_break(const tc_ref_cutter *cutter, double a, double b, double *value) {
  size_t lo = 0, hi = cutter->n_breaks; /* first break > a, or >= a */
  while (lo < hi) {
    size_t mid = lo + (hi - lo) / 2;
    if (b > a ? cutter->breaks[mid] <= a : cutter->breaks[mid] < a)
      lo = mid + 1;
    else
      hi = mid;
  }
  if (b > a ? lo == cutter->n_breaks : lo == 0) return false;
  *value = cutter->breaks[b > a ? lo : lo - 1];
  return b > a ? *value < b : *value > b;
}

static double cubic(const double c[4], double u) { return c[0] + u * (c[1] + u * (c[2] + u * c[3])); }

static void open_stretch(tc_ref_cutter *cutter) {
  const double *c = cutter->c;
  double u = cutter->stretch ? cutter->bend[cutter->stretch - 1] : 0;
  cutter->u = u;
  cutter->value = cubic(c, u);
  cutter->end = cubic(c, cutter->bend[cutter->stretch]);
  cutter->d[0] = c[1] + u * (2 * c[2] + u * 3 * c[3]);
  cutter->d[1] = c[2] + 3 * c[3] * u;
  cutter->d[2] = c[3];
  cutter->fresh = false;
}

/* Moves the polynomial's origin to the front of what is left. Widths are found from the last crossing, where the value
 * is known exactly, so that two knots a rounding error apart still make a piece of the right width. */
static void advance(tc_ref_cutter *cutter, double x, double value) {
  double *d = cutter->d;
  d[0] += x * (2 * d[1] + x * 3 * d[2]);
  d[1] += 3 * d[2] * x;
  cutter->u += x;
  cutter->value = value;
}

bool tc_ref_cutter_next(tc_ref_cutter *cutter, tc_ref_piece *piece) {
  while (cutter->stretch < cutter->n_bends) {
    if (cutter->fresh) open_stretch(cutter);
    double rest = cutter->bend[cutter->stretch] - cutter->u, knot;
    if (!(rest > 0)) {
      cutter->stretch++;
      cutter->fresh = true;
      continue;
    }
    piece->cell = cutter->cell;
    piece->from = cutter->u;
    piece->mm = cutter->mm;
    piece->front = cutter->value;
    for (int i = 0; i < 3; i++)
      piece->d[i] = cutter->d[i];
    if (next_break(cutter, cutter->value, cutter->end, &knot)) {
      piece->width = solve(cutter->d, rest, knot - cutter->value);
      piece->back = knot;
      advance(cutter, piece->width, knot);
    } else {
      piece->width = rest;
      piece->back = cutter->end;
      cutter->stretch++;
      cutter->fresh = true;
    }
    return true;
  }
  return false;
}
