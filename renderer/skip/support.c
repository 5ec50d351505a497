#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>

#include "renderer/base/clock.h"
#include "renderer/classify/transfer.h"
#include "renderer/skip/skip.h"

static uint64_t take_serial(void) {
  static atomic_uint_fast64_t next_serial = 1;
  return atomic_fetch_add(&next_serial, 1);
}

tc_support *tc_support_surface(double lo, double hi, GError **error) {
  tc_support *s = calloc(1, sizeof *s);
  if (s)
    *s = (tc_support){.lo = lo, .hi = hi, .serial = take_serial(), .bytes = sizeof *s};
  else
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "isosurface: out of memory");
  return s;
}

tc_support *tc_support_build(const tc_table_params *p, GError **error) {
  double start = tc_now_ms();
  tc_support *s = calloc(1, sizeof *s);
  uint32_t *used = calloc((size_t)p->n + 4, sizeof *used);
  if (!s || !used) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "support of %d values: out of memory", p->n);
    free(s);
    free(used);
    return NULL;
  }
  double width = p->voxel_hi - p->voxel_lo, before = 0;
  bool some_before = false;
  for (int j = 0; j <= p->n; j++) {
    double value = p->slope * (p->voxel_lo + width * j / (p->n - 1)) + p->intercept;
    bool some = tc_extinction(p->tf, value) > 0;
    if (j > 0) used[j] = used[j - 1] + (some_before || some || tc_extinction_mean(p->tf, before, value) > 0);
    before = value;
    some_before = some;
  }
  for (int j = p->n + 1; j < p->n + 4; j++) used[j] = used[p->n];
  *s = (tc_support){.n = p->n, .lo = p->voxel_lo, .hi = p->voxel_hi, .used = used,
                    .serial = take_serial(), .bytes = ((size_t)p->n + 4) * sizeof *used};
  s->build_ms = tc_now_ms() - start;
  return s;
}

void tc_support_free(tc_support *support) {
  if (!support) return;
  free(support->used);
  free(support);
}

static double node_of(const tc_table_params *p, double value) {
  return ((value - p->intercept) / p->slope - p->voxel_lo) * (p->n - 1) / (p->voxel_hi - p->voxel_lo);
}

/* The zones are narrowed by the reach of a look-up and by one node for rounding, as in empty_ranges.c. */
void tc_support_zones(const tc_table_params *p, double *below, double *above) {
  const tc_knot *knots = p->tf->points;
  const size_t count = p->tf->count;
  double low = p->n + 4, high = -2; /* range of visible nodes, within the data's range */
  for (size_t i = 0; i <= count; i++) { /* from knot i - 1 to knot i */
    if (knots[i ? i - 1 : 0].amount <= 0 && knots[i < count ? i : count - 1].amount <= 0) continue;
    const double a = node_of(p, i ? knots[i - 1].value : -INFINITY), b = node_of(p, i < count ? knots[i].value : INFINITY);
    if (fmax(a, b) < 0 || fmin(a, b) > p->n) continue;
    low = fmin(low, fmin(a, b));
    high = fmax(high, fmax(a, b));
  }
  *below = ceil(fmax(low, -1)) - 4;
  *above = floor(fmin(high, p->n + 1)) + 2;
}

bool tc_skip_possible(const tc_transfer_function *tf, double value_min, double value_max) {
  const tc_knot *p = tf->points;
  size_t last = tf->count - 1;
  if (p[0].amount <= 0 && value_min < p[0].value) return true;
  if (p[last].amount <= 0 && value_max > p[last].value) return true;
  for (size_t i = 0; i < last; i++)
    if (p[i].amount <= 0 && p[i + 1].amount <= 0 && p[i + 1].value > value_min && p[i].value < value_max) return true;
  return false;
}
