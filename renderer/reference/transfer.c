/* The transfer function: extinction and colour between two knots (NUMERICS section 0). */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/reference/internal.h"

#define SRGB_CORNER 0.04045     /* end of sRGB's linear part */
#define LARGEST_EXTINCTION 1e30 /* keeps products finite; opaque after 1e-28 mm */

double tc_ref_to_linear(double c) { return c <= SRGB_CORNER ? c / 12.92 : pow((c + 0.055) / 1.055, 2.4); }

static bool knot_is_sane(const tc_knot *k) {
  return isfinite(k->value) && isfinite(k->color[0]) && isfinite(k->color[1]) && isfinite(k->color[2]) &&
         k->amount >= 0;
}

static int ascending(const void *a, const void *b) {
  double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Breaks: the values of the knots, and in linear light also those at which a channel passes sRGB's corner. */
static void find_breaks(tc_ref_transfer *t) {
  size_t n = 0;
  for (size_t i = 0; i < t->n; i++) t->breaks[n++] = t->knots[i].value;
  for (size_t i = 0; t->linear_light && i + 1 < t->n; i++) {
    const tc_knot *a = &t->knots[i], *b = a + 1;
    for (int c = 0; c < 3; c++)
      if ((a->color[c] < SRGB_CORNER) != (b->color[c] < SRGB_CORNER))
        t->breaks[n++] = a->value + (SRGB_CORNER - a->color[c]) / (b->color[c] - a->color[c]) * (b->value - a->value);
  }
  qsort(t->breaks, n, sizeof *t->breaks, ascending);
  t->n_breaks = 0;
  for (size_t i = 0; i < n; i++)
    if (i == 0 || t->breaks[i] > t->breaks[i - 1]) t->breaks[t->n_breaks++] = t->breaks[i];
}

bool tc_ref_transfer_set_up(tc_ref_transfer *t, const tc_transfer_function *from, bool linear_light) {
  *t = (tc_ref_transfer){
      .n = from->count, .opacity = from->kind == TC_KNOT_OPACITY, .linear_light = linear_light, .per_mm = 1};
  if (from->count == 0) return false;
  if (t->opacity) {
    if (!(from->unit_distance_mm > 0) || !isfinite(from->unit_distance_mm)) return false;
    t->per_mm = 1 / from->unit_distance_mm;
  }
  for (size_t i = 0; i < from->count; i++)
    if (!knot_is_sane(&from->points[i]) || (i && from->points[i].value < from->points[i - 1].value)) return false;
  t->knots = g_memdup2(from->points, from->count * sizeof *from->points);
  t->breaks = g_new(double, 4 * from->count);
  for (size_t i = 0; i < t->n; i++) t->knots[i].amount = fmin(t->knots[i].amount, t->opacity ? 1 : LARGEST_EXTINCTION);
  find_breaks(t);
  return true;
}

void tc_ref_transfer_clear(tc_ref_transfer *t) {
  g_free(t->knots);
  g_free(t->breaks);
  *t = (tc_ref_transfer){0};
}

/* How many knots have a value <= v (at a jump, all of its knots). */
static size_t knots_up_to(const tc_ref_transfer *t, double v) {
  size_t lo = 0, hi = t->n;
  while (lo < hi) {
    size_t mid = lo + (hi - lo) / 2;
    if (t->knots[mid].value <= v)
      lo = mid + 1;
    else
      hi = mid;
  }
  return lo;
}

void tc_ref_span_above(const tc_ref_transfer *t, double value, tc_ref_span *span) {
  size_t above = knots_up_to(t, value);
  const tc_knot *end[2] = {&t->knots[above ? above - 1 : 0], &t->knots[above < t->n ? above : t->n - 1]};
  span->base = end[0]->value;
  span->inverse_width = end[0] == end[1] ? 0 : 1 / (end[1]->value - end[0]->value);
  for (int i = 0; i < 2; i++) {
    /* Opacity 1 has no finite extinction: a knot is clamped to 1 - 2^-24. */
    span->amount[i] = t->opacity ? fmin(end[i]->amount, 1 - 0x1p-24) : end[i]->amount;
    span->clear[i] = fmax(1 - end[i]->amount, 0x1p-24);
    memcpy(span->color[i], end[i]->color, sizeof span->color[i]);
  }
  span->per_mm = t->per_mm;
  span->opacity = t->opacity;
  span->linear_light = t->linear_light;
  span->one_extinction = span->amount[0] == span->amount[1];
  span->no_extinction = span->amount[0] == 0 && span->amount[1] == 0;
  span->one_color = memcmp(span->color[0], span->color[1], sizeof span->color[0]) == 0;
}

bool tc_ref_transfer_empty(const tc_ref_transfer *t, double lo, double hi) {
  size_t above = knots_up_to(t, lo);
  if (above < t->n && t->knots[above].value <= hi) return false; /* more than one span */
  const tc_knot *a = &t->knots[above ? above - 1 : 0], *b = &t->knots[above < t->n ? above : t->n - 1];
  return a->amount == 0 && b->amount == 0;
}

/* 1/mm. Opacity is interpolated as 1 - opacity, so that the logarithm's argument keeps its digits near opacity 1. */
double tc_ref_span_extinction(const tc_ref_span *span, double f) {
  double amount = span->amount[0] * (1 - f) + span->amount[1] * f;
  if (!span->opacity) return amount;
  double minus_log = amount < 0.5 ? -log1p(-amount) : -log(span->clear[0] * (1 - f) + span->clear[1] * f);
  return minus_log * span->per_mm;
}

void tc_ref_span_color(const tc_ref_span *span, double f, double rgb[3]) {
  for (int c = 0; c < 3; c++) {
    rgb[c] = span->color[0][c] + f * (span->color[1][c] - span->color[0][c]);
    if (span->linear_light) rgb[c] = tc_ref_to_linear(rgb[c]);
  }
}
