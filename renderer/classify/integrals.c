#include "renderer/classify/integrals.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/classify/segments.h"
#include "renderer/classify/transfer.h"
#include "renderer/base/clock.h"

#define MOST_TAU 1e30 /* 1/mm: opaque at any length, and sums stay finite */

/* One node interval: means of (L tau, tau), and their linear change: mean - tilt at the front end, mean + tilt at
 * the back. */
typedef struct interval {
  double mean[4], tilt[4];
} interval;

static double extinction(const tc_table_params *p, double value) { return fmin(tc_extinction(p->tf, value), MOST_TAU); }

static void color(const tc_table_params *p, double value, double rgb[3]) {
  tc_color(p->tf, value, rgb);
  for (int c = 0; c < 3 && p->linear_light; c++) rgb[c] = tc_srgb_to_linear(rgb[c]);
}

/* Adds part of an interval without a knot inside: the exact mean extinction, and the mean colour by three Gauss
 * points. */
static void add_stretch(interval *into, const tc_table_params *p, double from, double to, double share) {
  static const double place[3] = {-0.774596669241483377, 0, 0.774596669241483377}, weight[3] = {5, 8, 5};
  double mean = share * fmin(tc_extinction_mean(p->tf, from, to), MOST_TAU), sum[4] = {0}, rgb[3];
  if (!(mean > 0)) return;
  for (int i = 0; i < 3; i++) {
    double value = 0.5 * (from + to) + 0.5 * (to - from) * place[i], w = weight[i] * extinction(p, value);
    color(p, value, rgb);
    for (int c = 0; c < 3; c++) sum[c] += w * rgb[c];
    sum[3] += w;
  }
  for (int c = 0; c < 3; c++) into->mean[c] += sum[3] > 0 ? mean * (sum[c] / sum[3]) : 0;
  into->mean[3] += mean;
}

/* Sets the tilt, limited so that tau and L tau stay at least 0 and L at most that of the brighter end. */
static void add_tilt(interval *into, const tc_table_params *p, double v0, double v1) {
  double in[2] = {v0 + (v1 - v0) * 1e-9, v1 - (v1 - v0) * 1e-9}, rgb[2][3], tau[2], *mean = into->mean;
  for (int e = 0; e < 2; e++) {
    tau[e] = extinction(p, in[e]);
    color(p, in[e], rgb[e]);
  }
  into->tilt[3] = fmin(fmax(0.5 * (tau[1] - tau[0]), -mean[3]), mean[3]);
  for (int c = 0; c < 3; c++) {
    double most = mean[3] > 0 ? fmax(mean[c] / mean[3], fmax(rgb[0][c], rgb[1][c])) : 0, wanted, low, high;
    wanted = 0.5 * (rgb[1][c] * tau[1] - rgb[0][c] * tau[0]);
    low = fmax(-mean[c], mean[c] - most * (mean[3] - into->tilt[3]));
    high = fmin(mean[c], most * (mean[3] + into->tilt[3]) - mean[c]);
    into->tilt[c] = fmin(fmax(wanted, low), high);
  }
}

#define POLL 64 /* intervals, or knots of one interval, between two polls of the halt */

/* The interval from value v0 to v1. p->tf: the knots near it. False: halted. */
static bool integrate(interval *into, const tc_table_params *p, double v0, double v1, const tc_halt *halt) {
  double from = v0, width = v1 - v0;
  size_t at = 0;
  do {
    double next = tc_next_knot(p->tf, from, v1, &at);
    add_stretch(into, p, from, next, width != 0 ? (next - from) / width : 1);
    from = next;
    if (at % POLL == POLL - 1 && tc_halt_within(halt)) return false;
  } while (from != v1);
  add_tilt(into, p, v0, v1);
  return true;
}

static void store(float entry[4], const double value[4]) {
  for (int c = 0; c < 4; c++) entry[c] = (float)value[c];
}

/* One level: sums from each block's middle outwards to its nodes. means: [n][4] of the node intervals. */
static void fill_level(float (*level)[4], const double (*means)[4], int n, int half) {
  for (int middle = half; middle - half <= n; middle += 2 * half) {
    double down[4] = {0}, up[4] = {0};
    for (int p = middle - 1; p >= middle - half; p--) {
      if (p >= n) continue; /* the last block may end before its middle, which no pair of nodes needs */
      for (int c = 0; c < 4; c++) down[c] += means[p][c];
      store(level[p], down);
    }
    for (int q = middle + 1; q < middle + half && q <= n; q++) {
      for (int c = 0; c < 4; c++) up[c] += means[q - 1][c];
      store(level[q], up);
    }
  }
}

static int level_count(int n) {
  int levels = 1;
  while (n >> (levels - 1)) levels++;
  return levels;
}

static tc_integrals *integrals_new(const tc_table_params *p) {
  static atomic_uint_fast64_t next_serial = 1;
  tc_integrals *t = calloc(1, sizeof *t);
  if (!t) return NULL;
  size_t nodes = (size_t)p->n + 1;
  *t = (tc_integrals){.n = p->n, .lo = p->voxel_lo, .hi = p->voxel_hi, .levels_start = (int)(2 * nodes),
                      .count = 2 * nodes + (size_t)level_count(p->n) * nodes + 1};
  t->bytes = t->count * 4 * sizeof(float);
  t->serial = atomic_fetch_add(&next_serial, 1);
  t->entries = calloc(t->count, 4 * sizeof(float));
  if (t->entries) return t;
  free(t);
  return NULL;
}

/* Fills the entries with both ends of each node interval, and means with their means. False: halted. */
static bool fill_intervals(tc_integrals *t, const tc_table_params *params, double (*means)[4], const tc_halt *halt) {
  tc_table_params about = *params;
  double scale = params->slope * (params->voxel_hi - params->voxel_lo) / (params->n - 1);
  double base = params->slope * params->voxel_lo + params->intercept;
  for (int j = 0; j <= params->n; j++) {
    if (j % POLL == 0 && tc_halt_within(halt)) return false;
    double v0 = base + scale * j, v1 = base + scale * (j + 1), ends[2][4];
    const tc_transfer_function near = tc_knots_between(params->tf, v0, v1);
    about.tf = &near;
    interval it = {0};
    if (!integrate(&it, &about, v0, v1, halt)) return false;
    for (int c = 0; c < 4; c++) {
      means[j][c] = it.mean[c];
      ends[0][c] = it.mean[c] - it.tilt[c];
      ends[1][c] = it.mean[c] + it.tilt[c];
    }
    store(t->entries + 8 * (size_t)j, ends[0]);
    store(t->entries + 8 * (size_t)j + 4, ends[1]);
  }
  return true;
}

tc_integrals *tc_integrals_build(const tc_table_params *params, const tc_halt *halt, GError **error) {
  double start = tc_now_ms();
  tc_integrals *t = integrals_new(params);
  double(*means)[4] = calloc((size_t)params->n + 1, sizeof *means);
  bool ok = t && means;
  if (!ok)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "integrals of %d values: out of memory", params->n);
  else
    ok = fill_intervals(t, params, means, halt) || tc_halt_say(halt, error);
  if (!ok) {
    tc_integrals_free(t);
    free(means);
    return NULL;
  }
  float(*level)[4] = (float(*)[4])(t->entries + 4 * (size_t)t->levels_start) + params->n + 1;
  for (int half = 1; half <= params->n; half *= 2, level += params->n + 1)
    fill_level(level, (const double(*)[4])means, params->n, half);
  free(means);
  t->build_ms = tc_now_ms() - start;
  return t;
}

void tc_integrals_free(tc_integrals *integrals) {
  if (!integrals) return;
  free(integrals->entries);
  free(integrals);
}

bool tc_integrals_serve(tc_classification classification) {
  return classification == TC_APPROXIMATE || classification == TC_POST || classification == TC_LINEARIZED;
}
