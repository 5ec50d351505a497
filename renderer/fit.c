/* Scene defaults that fit a volume. */
#include <math.h>
#include <string.h>

#include "renderer/tomocast.h"

/* Percentile of the voxels by a histogram: robust against a few outliers. */
static void percentiles(const tc_volume *volume, double low, double high, double *lo, double *hi) {
  enum { BINS = 1024 };
  uint64_t counts[BINS], total = 0, sum = 0;
  double edges[BINS + 1];
  tc_volume_histogram(volume, BINS, counts, edges);
  for (int i = 0; i < BINS; i++) total += counts[i];
  *lo = edges[0], *hi = edges[BINS];
  bool have_low = false;
  for (int i = 0; i < BINS; i++) {
    sum += counts[i];
    if (!have_low && (double)sum >= low * (double)total) *lo = edges[i], have_low = true;
    if ((double)sum >= high * (double)total) {
      *hi = edges[i + 1];
      return;
    }
  }
}

static void fit_camera(tc_camera *camera, const tc_volume *volume) {
  double lo[3], hi[3], mid[3], corner[3], p[3], radius = 0;
  tc_volume_index_box(volume, lo, hi);
  for (int k = 0; k < 3; k++) mid[k] = 0.5 * (lo[k] + hi[k]);
  tc_volume_index_to_lps(volume, mid, camera->target);
  for (int c = 0; c < 8; c++) {
    double d2 = 0;
    for (int k = 0; k < 3; k++) corner[k] = c >> k & 1 ? hi[k] : lo[k];
    tc_volume_index_to_lps(volume, corner, p);
    for (int k = 0; k < 3; k++) d2 += (p[k] - camera->target[k]) * (p[k] - camera->target[k]);
    radius = fmax(radius, sqrt(d2));
  }
  if (!(radius > 0)) radius = 1;
  camera->projection = TC_PERSPECTIVE;
  camera->fov_y_deg = 30;
  /* From the front, head up; the bounding sphere fits with room to turn. */
  double distance = radius / sin(camera->fov_y_deg * M_PI / 360);
  memcpy(camera->position, camera->target, sizeof camera->position);
  camera->position[1] -= distance;
  camera->up[0] = 0, camera->up[1] = 0, camera->up[2] = 1;
  camera->height_mm = 2 * radius;
}

/* Values in Hounsfield units; a CT that was never rescaled has no use for them. */
static bool is_hounsfield(const tc_volume *volume) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  return (!strcmp(d->modality, "CT") || !strcmp(d->unit, "HU") || s->min < -500) && s->min < -100 && s->max > 300;
}

#define BONE_HU 300

/* Bone in a CT; else what parts the histogram best: the largest variance between the two sides (Otsu, A threshold
 * selection method from gray-level histograms, IEEE Trans. SMC 9(1), 1979). */
static double surface_value(const tc_volume *volume) {
  enum { BINS = 256 };
  uint64_t counts[BINS];
  double edges[BINS + 1], all = 0, total = 0, below = 0, sum = 0, most = -1;
  int best = BINS / 2;
  if (is_hounsfield(volume)) return BONE_HU;
  tc_volume_histogram(volume, BINS, counts, edges);
  for (int i = 0; i < BINS; i++) all += (double)counts[i], total += (double)counts[i] * i;
  for (int i = 1; i < BINS; i++) {
    below += (double)counts[i - 1];
    sum += (double)counts[i - 1] * (i - 1);
    if (!(below > 0 && below < all)) continue;
    double apart = sum / below - (total - sum) / (all - below), variance = below * (all - below) * apart * apart;
    if (variance > most) most = variance, best = i;
  }
  return edges[best];
}

static const char *preset_for(const tc_volume *volume) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  if (!strcmp(d->modality, "XA")) return "vessels";
  if (!strcmp(d->format, "demo") && !strcmp(d->modality, "CT")) return "ct-head";
  if (is_hounsfield(volume)) return "ct-bone";
  if (!strcmp(d->modality, "MR")) return "mr-default";
  return "surface";
}

/* One value has no range: a unit, or what a float can tell apart at its size. */
static double above(double lo, double hi) { return hi - lo > 1e-6 * fabs(lo) ? hi : lo + fmax(1, 1e-3 * fabs(lo)); }

void tc_scene_fit(tc_scene *scene, const tc_volume *volume) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  fit_camera(&scene->camera, volume);
  double lo, hi;
  percentiles(volume, 0.001, 0.999, &lo, &hi);
  hi = above(lo, hi);
  if (d->window_width > 0) {
    scene->window.center = d->window_center;
    scene->window.width = d->window_width;
  } else {
    scene->window.center = 0.5 * (lo + hi);
    scene->window.width = hi - lo;
  }
  scene->isosurface.value = surface_value(volume);
  memcpy(scene->mpr.center, scene->camera.target, sizeof scene->mpr.center);
  if (!tc_transfer_function_set_preset(&scene->transfer_function, preset_for(volume), s->min, above(s->min, s->max)))
    tc_transfer_function_set_preset(&scene->transfer_function, "grey-ramp", s->min, above(s->min, s->max));
}
