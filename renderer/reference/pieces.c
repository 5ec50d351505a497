/* Cuts a cell's polynomial into monotone pieces that cross no break of the transfer function. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "renderer/reference/internal.h"

static double rise(const double *d, int degree, double x) {
  double sum = 0;
  for (int i = degree; i-- > 0;) sum = x * (d[i] + sum);
  return sum;
}

static double slope_of(const double *d, int degree, double x) {
  double sum = 0;
  for (int i = degree; i-- > 0;) sum = sum * x + (i + 1) * d[i];
  return sum;
}

/* x in (lo, hi) with rise(x) = want, for a monotone rise that passes want: Newton steps, bisection where they leave
 * the bracket. */
static double solve(const double *d, int degree, double lo, double hi, double want) {
  double from = rise(d, degree, lo) - want, to = rise(d, degree, hi) - want, sign = to >= from ? 1 : -1;
  double x = lo + (hi - lo) * fmin(fmax(-from / (to - from), 0), 1);
  for (int i = 0; i < 200; i++) {
    double f = sign * (rise(d, degree, x) - want), slope = sign * slope_of(d, degree, x);
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

/* The sign changes of c[0] + c[1] u + ... inside (0, 1), ascending. Between two sign changes of its derivative a
 * polynomial is monotone, so they are found degree by degree. */
static int sign_changes(const double *c, int degree, double *roots) {
  while (degree > 0 && c[degree] == 0) degree--;
  if (degree == 0) return 0;
  double derivative[TC_REF_DEGREE], ends[TC_REF_DEGREE + 1], from = 0, below = c[0];
  for (int i = 0; i < degree; i++) derivative[i] = (i + 1) * c[i + 1];
  int n = sign_changes(derivative, degree - 1, ends), found = 0;
  ends[n++] = 1;
  for (int i = 0; i < n; i++) {
    double above = c[0] + rise(c + 1, degree, ends[i]);
    if (below < 0 ? above > 0 : below > 0 && above < 0) roots[found++] = solve(c + 1, degree, from, ends[i], -c[0]);
    from = ends[i];
    below = above;
  }
  return found;
}

/* Real roots of c1 + 2 c2 u + 3 c3 u^2 inside (0, 1), ascending; by the form without cancellation. */
static int cubic_extrema(const double c[4], double roots[2]) {
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

static int extrema(const tc_ref_cell *cell, double *roots) {
  if (cell->degree <= 3) return cell->degree == 3 ? cubic_extrema(cell->c, roots) : 0;
  double derivative[TC_REF_DEGREE];
  for (int i = 0; i < cell->degree; i++) derivative[i] = (i + 1) * cell->c[i + 1];
  return sign_changes(derivative, cell->degree - 1, roots);
}

void tc_ref_cutter_start(tc_ref_cutter *cutter, const tc_ref_cell *cell, const double *breaks, size_t n_breaks) {
  *cutter = (tc_ref_cutter){.cell = cell, .breaks = breaks, .n_breaks = n_breaks, .mm = cell->length, .fresh = true};
  cutter->n_bends = extrema(cell, cutter->bend);
  cutter->bend[cutter->n_bends++] = 1;
}

/* The first break strictly between a and b, coming from a; false if there is none. */
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

void tc_ref_shift(double *c, int degree, double u) {
  for (int i = 0; i < degree; i++)
    for (int j = degree - 1; j >= i; j--) c[j] += u * c[j + 1];
}

static void open_stretch(tc_ref_cutter *cutter) {
  const tc_ref_cell *cell = cutter->cell;
  double u = cutter->stretch ? cutter->bend[cutter->stretch - 1] : 0, c[TC_REF_DEGREE + 1];
  memcpy(c, cell->c, sizeof c);
  tc_ref_shift(c, cell->degree, u);
  cutter->u = u;
  cutter->value = cell->c[0] + rise(cell->c + 1, cell->degree, u);
  cutter->end = cell->c[0] + rise(cell->c + 1, cell->degree, cutter->bend[cutter->stretch]);
  memcpy(cutter->d, c + 1, sizeof cutter->d);
  cutter->fresh = false;
}

/* Moves the polynomial's origin to the front of the rest. Widths are measured from the last crossing, where the
 * value is known exactly: even two knots a rounding error apart give a piece of the right width. */
static void advance(tc_ref_cutter *cutter, double x, double value) {
  double c[TC_REF_DEGREE + 1] = {value};
  memcpy(c + 1, cutter->d, sizeof cutter->d);
  tc_ref_shift(c, cutter->cell->degree, x);
  memcpy(cutter->d, c + 1, sizeof cutter->d);
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
    memcpy(piece->d, cutter->d, sizeof piece->d);
    if (next_break(cutter, cutter->value, cutter->end, &knot)) {
      piece->width = solve(cutter->d, cutter->cell->degree, 0, rest, knot - cutter->value);
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
