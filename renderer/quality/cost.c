#include "renderer/quality/cost.h"

#include <math.h>

#define KEPT 0.85       /* of the older frames' weight, at each new one */
#define RAY_SHARE 0.25  /* a / b while nothing tells them apart */
#define PRIOR 0.02      /* weight of that, against the frames' */
#define SURPRISE 1.5    /* a frame this many times as slow: the older ones tell little any more */
#define FINEST_RUNG (-24)
#define COARSEST_RUNG 16

static void solve(const tc_quality_cost *c, double *a, double *b) {
  /* least squares, and PRIOR * (a - RAY_SHARE b)^2 */
  double p = PRIOR * c->w, m00 = c->w + p, m01 = c->x - p * RAY_SHARE, m11 = c->xx + p * RAY_SHARE * RAY_SHARE;
  double det = m00 * m11 - m01 * m01;
  *a = (c->y * m11 - c->xy * m01) / det;
  *b = (c->xy * m00 - c->y * m01) / det;
  if (*a < 0) *a = 0, *b = c->xy / c->xx;
  if (*b < 0) *b = 0, *a = c->y / c->w;
}

double tc_quality_cost_ms(const tc_quality_cost *cost, double pixels, double step) {
  double a, b;
  if (!(cost->w > 0)) return 0;
  solve(cost, &a, &b);
  return pixels * (a + b / step);
}

void tc_quality_cost_add(tc_quality_cost *c, double pixels, double step, double ms) {
  if (!(pixels > 0) || !(step > 0) || !(ms > 0)) return;
  double expected = tc_quality_cost_ms(c, pixels, step), kept = expected > 0 && ms > SURPRISE * expected ? 0 : KEPT;
  double x = 1 / step, y = ms / pixels, w = 1 / (y * y);
  c->w = c->w * kept + w;
  c->x = c->x * kept + w * x;
  c->xx = c->xx * kept + w * x * x;
  c->y = c->y * kept + w * y;
  c->xy = c->xy * kept + w * x * y;
}

double tc_quality_cost_step(const tc_quality_cost *cost, double pixels, double ms) {
  if (!(cost->w > 0)) return 1;
  for (int rung = FINEST_RUNG; rung < COARSEST_RUNG; rung++)
    if (tc_quality_cost_ms(cost, pixels, exp2(rung / 8.0)) <= ms) return exp2(rung / 8.0);
  return exp2(COARSEST_RUNG / 8.0);
}
