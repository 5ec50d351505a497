/* Windows for projections, from a coarse projection of the volume along the axis of the first view. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/presets/fit.h"
#include "renderer/tomocast.h"
#include "renderer/volume/voxel.h"

/* Largest number of pixels per side, and of samples along a ray. */
#define SIDE 96
#define DEPTH 128
/* Share of the body's pixels that may be white. */
#define MOST_WHITE 0.3
/* Thickness of the middle slab for mode minip, as a share of the depth. */
#define SLAB 0.05

/* Per pixel: results over all samples, and over those of a slab in the middle. */
typedef struct sheet {
  double most[SIDE * SIDE], mean[SIDE * SIDE], least[SIDE * SIDE];
  int count;
} sheet;

/* The index axis that the first view looks along. */
static int view_axis(const tc_volume *volume) {
  const double *row = tc_volume_describe(volume)->direction + 3 * tc_fit_axis(volume);
  int axis = 0;
  for (int k = 1; k < 3; k++)
    if (fabs(row[k]) > fabs(row[axis])) axis = k;
  return axis;
}

static int samples_of(int voxels, int most) { return voxels < most ? voxels : most; }
static int place(int i, int samples, int voxels) {
  return samples > 1 ? (int)((int64_t)i * (voxels - 1) / (samples - 1)) : 0;
}

static double value_at(const tc_volume *volume, const int at[3]) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const size_t row = (size_t)at[2] * (size_t)d->dims[1] + (size_t)at[1];
  return d->slope * tc_voxel_at(d->type, tc_volume_data(volume), row * (size_t)d->dims[0] + (size_t)at[0]) + d->intercept;
}

static void cast(const tc_volume *volume, int axis, int at[3], sheet *sheet) {
  const int voxels = tc_volume_describe(volume)->dims[axis], samples = samples_of(voxels, DEPTH);
  double most = -INFINITY, least = INFINITY, sum = 0;
  for (int i = 0; i < samples; i++) {
    at[axis] = place(i, samples, voxels);
    const double value = value_at(volume, at);
    most = fmax(most, value);
    sum += value;
    if (fabs((double)i - 0.5 * (samples - 1)) <= 0.5 + 0.5 * SLAB * samples) least = fmin(least, value);
  }
  sheet->most[sheet->count] = most;
  sheet->mean[sheet->count] = sum / samples;
  sheet->least[sheet->count++] = least;
}

static void project(const tc_volume *volume, sheet *sheet) {
  const int *dims = tc_volume_describe(volume)->dims, axis = view_axis(volume), u = (axis + 1) % 3, v = (axis + 2) % 3;
  const int across = samples_of(dims[u], SIDE), down = samples_of(dims[v], SIDE);
  int at[3];
  sheet->count = 0;
  for (int j = 0; j < down; j++)
    for (int i = 0; i < across; i++) {
      at[u] = place(i, across, dims[u]);
      at[v] = place(j, down, dims[v]);
      cast(volume, axis, at, sheet);
    }
}

static int by_value(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Percentile of sorted values. */
static double percentile(const double *sorted, int count, double share) { return sorted[(int)(share * (count - 1))]; }

static int count_below(const double *sorted, int count, double value) {
  int n = 0;
  while (n < count && sorted[n] < value) n++;
  return n;
}

static void set_window(tc_fit *fit, tc_mode mode, double black, double white) {
  if (!(white - black > 1e-6 * fabs(black))) white = black + fmax(1, 1e-3 * fabs(black)); /* a single value */
  fit->windows[mode].center = 0.5 * (black + white);
  fit->windows[mode].width = white - black;
}

/* The window for vessels if it leaves the body grey, else that for bone, else percentiles of the projection. */
static void fit_mip(tc_fit *fit, const double *sorted, int count) {
  static const char *const names[] = {"ct-angio", "ct-bone"};
  const int air = count_below(sorted, count, fit->dense);
  const double *body = air < count ? sorted + air : sorted;
  const int pixels = air < count ? count - air : count;
  for (size_t i = 0; fit->hounsfield && i < sizeof names / sizeof *names; i++) {
    const tc_window_preset *w = tc_window_preset_named(names[i]);
    const int white = pixels - count_below(body, pixels, w->center + 0.5 * w->width);
    set_window(fit, TC_MODE_MIP, w->center - 0.5 * w->width, w->center + 0.5 * w->width);
    if (white <= MOST_WHITE * pixels) return;
  }
  set_window(fit, TC_MODE_MIP, percentile(sorted, count, 0.05), percentile(body, pixels, 0.99));
}

void tc_fit_windows(tc_fit *fit, const tc_volume *volume, const tc_volume *body) {
  sheet *s = tc_volume_sparse(volume) ? NULL : malloc(sizeof *s); /* slices and projections need a grid */
  if (!s) return;
  project(body ? body : volume, s);
  double *const lists[] = {s->most, s->mean, s->least};
  for (int i = 0; i < 3; i++) qsort(lists[i], (size_t)s->count, sizeof *lists[i], by_value);
  fit_mip(fit, s->most, s->count);
  set_window(fit, TC_MODE_AVERAGE, percentile(s->mean, s->count, 0.05), percentile(s->mean, s->count, 0.99));
  const tc_window_preset *lung = tc_window_preset_named("ct-lung");
  if (fit->hounsfield) set_window(fit, TC_MODE_MINIP, lung->center - 0.5 * lung->width, lung->center + 0.5 * lung->width);
  else set_window(fit, TC_MODE_MINIP, percentile(s->least, s->count, 0.05), percentile(s->least, s->count, 0.98));
  free(s);
}
