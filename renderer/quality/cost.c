#include "renderer/quality/cost.h"

#include <math.h>
#include <string.h>

#include "renderer/raycast/isosurface.h"

#define KEPT 0.85             /* factor on the weight of older frames at each new frame */
#define RAY_SHARE 0.25        /* assumed a / b while all frames had one spacing */
#define RAY_SHARE_WEIGHT 0.02 /* weight of that assumption in the fit, relative to the weight of the frames */
#define NEW_LOOK 2            /* a frame this many times slower or faster than expected: older frames are dropped */
#define PLANNED_SHARE 0.9 /* largest share of a time bound to plan for, however well times are predicted */
#define LEAST_SHARE 0.5
#define DEVIATIONS 2.2   /* standard deviations of margin: normal scatter needs 1.65, but times are skewed */
#define SPREAD_KEPT 0.9  /* factor on the older spread at each new frame */
#define FIRST_SPREAD 0.1 /* before any frame: the first frames are predicted badly */
#define PACE_WEIGHT 0.4  /* weight of the newest final frame in the smoothed ratio, which is a geometric mean */
#define FINEST_RUNG (-24)
#define COARSEST_RUNG 16
/* Cost of a segment of preintegrated2 (two samples, one look-up) relative to one of preintegrated. The ratio is a
 * constant and not measured at run time, so that one scene gives one picture under a bound on the error.
 * On the cpu the growth of frame times from step 1 to step 0.5 gives 1.6 to 2.1, with shading 1.3 to 1.9, because both
 * methods compute one gradient a segment (seven volumes, AVX-512 and AVX2, AMD Zen 4). With a ratio of 1.7,
 * preintegrated2 was chosen on vessels where its frames took up to 1.13 times as long; with 2.0 no frame took longer
 * beyond noise. On gl 1.4 to 1.5 from step 1 to 0.25, 1.3 with shading (llvmpipe; a GPU fetches as often). */
#define SECOND_ON_CPU 2.0
#define SECOND_ON_GL 1.5

tc_quality_cost tc_quality_cost_of(const char *backend) {
  return (tc_quality_cost){.spread = FIRST_SPREAD, .second = strcmp(backend, "gl") == 0 ? SECOND_ON_GL : SECOND_ON_CPU};
}

static void solve(const tc_quality_cost *c, double *a, double *b) {
  /* least squares, plus RAY_SHARE_WEIGHT * (a - RAY_SHARE b)^2 */
  double p = RAY_SHARE_WEIGHT * c->w, m00 = c->w + p, m01 = c->x - p * RAY_SHARE,
         m11 = c->xx + p * RAY_SHARE * RAY_SHARE;
  double det = m00 * m11 - m01 * m01;
  *a = (c->y * m11 - c->xy * m01) / det;
  *b = (c->xy * m00 - c->y * m01) / det;
  if (*a < 0) *a = 0, *b = c->xy / c->xx;
  if (*b < 0) *b = 0, *a = c->y / c->w;
}

double tc_quality_stretch(const tc_scene *scene) {
  return scene->mode == TC_MODE_DVR ? scene->sampling.rays_per_pixel : 1;
}

/* Segments per voxel at this spacing, in units of preintegrated's. */
static double segments(const tc_quality_cost *cost, const tc_scene *scene, double spacing) {
  bool second = scene->mode == TC_MODE_DVR && scene->classification == TC_PREINTEGRATED2;
  return (second ? cost->second : 1) / spacing;
}

static double fitted(const tc_quality_cost *cost, double rays, double x) {
  double a, b;
  if (!(cost->w > 0)) return 0;
  solve(cost, &a, &b);
  return rays * (a + b * x);
}

/* Beyond the largest number of segments per voxel of any frame, the time is extrapolated in proportion: an upper bound,
 * whatever a is. */
static double expected(const tc_quality_cost *cost, double rays, double x) {
  const double known = cost->w > 0 ? fmin(x, cost->most) : x;
  return fitted(cost, rays, known) * (x / known);
}

double tc_quality_cost_ms(const tc_quality_cost *cost, const tc_scene *scene, double pixels) {
  double spacing = scene->sampling.step * tc_quality_stretch(scene);
  return expected(cost, pixels * scene->sampling.rays_per_pixel, segments(cost, scene, spacing));
}

void tc_quality_cost_add(tc_quality_cost *c, const tc_scene *scene, double pixels, double ms) {
  double rays = pixels * scene->sampling.rays_per_pixel, spacing = scene->sampling.step * tc_quality_stretch(scene);
  if (!(rays > 0) || !(spacing > 0) || !(ms > 0) || tc_is_surface(scene->mode) || scene->mode == TC_MODE_SPLAT) return;
  /* A time between the fit and its upper bound was expected. */
  double x = segments(c, scene, spacing), was = fmin(fmax(ms, fitted(c, rays, x)), expected(c, rays, x));
  const double off = was > 0 ? fmax(ms / was, was / ms) : 1, kept = off > NEW_LOOK ? 0 : KEPT;
  if (was > 0) c->spread += (1 - SPREAD_KEPT) * (pow(log(fmin(off, NEW_LOOK)), 2) - c->spread);
  double y = ms / rays, w = 1 / (y * y);
  c->most = kept > 0 ? fmax(c->most, x) : x;
  c->w = c->w * kept + w;
  c->x = c->x * kept + w * x;
  c->xx = c->xx * kept + w * x * x;
  c->y = c->y * kept + w * y;
  c->xy = c->xy * kept + w * x * y;
}

void tc_quality_pace_add(tc_quality_pace *pace, double slower, bool moving, uint64_t revision) {
  if (!(slower > 0) || isinf(slower)) return;
  if (moving)
    pace->slower = slower, pace->revision = revision;
  else if (pace->followed)
    pace->final *= pow(slower, PACE_WEIGHT);
  pace->followed = false;
}

void tc_quality_pace_follow(tc_quality_pace *pace, tc_quality_cost *c, uint64_t revision) {
  if (!(pace->slower > 0) || pace->revision != revision) return;
  if (!(pace->final > 0)) pace->final = 1;
  const double factor = pace->slower * pace->final, square = factor * factor; /* weights are 1 / y^2 */
  c->w /= square, c->x /= square, c->xx /= square;
  c->y /= factor, c->xy /= factor;
  pace->slower = 0;
  pace->followed = true;
}

double tc_quality_cost_share(const tc_quality_cost *cost) {
  return fmin(PLANNED_SHARE, fmax(LEAST_SHARE, exp(-DEVIATIONS * sqrt(cost->spread))));
}

double tc_quality_cost_step(const tc_quality_cost *cost, const tc_scene *scene, double pixels, double ms) {
  double rays = pixels * scene->sampling.rays_per_pixel, stretch = tc_quality_stretch(scene);
  int rung = cost->w > 0 ? FINEST_RUNG : 0;
  while (rung < COARSEST_RUNG && expected(cost, rays, segments(cost, scene, exp2(rung / 8.0))) > ms) rung++;
  return exp2(rung / 8.0) / stretch;
}
