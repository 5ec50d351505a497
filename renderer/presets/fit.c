/* Scene defaults that fit a volume. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <glib.h>

#include "renderer/presets/fit.h"
#include "renderer/splat/vmd.h"
#include "renderer/tomocast.h"
#include "renderer/volume/body.h"
#include "renderer/volume/values.h"

/* Volume diagonal in mm for which presets are designed: a head's. */
#define PRESET_DIAGONAL_MM 400.0
#define AIR_HU -1000
/* Skin and fat are denser, the foam of tables is not. */
#define DENSE_HU -300
/* Without a unit: smallest value of a table, as a share of the way from the background to the body. */
#define SOFT 0.3
#define BONE_HU 300
/* Share of bone among the dense voxels: a head has more, a trunk less. */
#define HEAD_BONE 0.1
/* Largest share of the body's voxels that may be white in slices; smallest share of all voxels that counts as a body;
 * smallest share of the window's width that the body's values must span. */
#define MOST_WHITE 0.3
#define LEAST_BODY 0.02
#define LEAST_GREYS 0.05
/* Samples per side on each face of the volume. */
#define FACE_SIDE 24
/* A volume whose extent along one axis, relative to the others, is below this share is viewed along that axis. */
#define THIN 0.25

static double diagonal_of(const tc_volume *volume) {
  double lo[3], hi[3], a[3], b[3], sum = 0;
  tc_volume_index_box(volume, lo, hi);
  tc_volume_index_to_lps(volume, lo, a);
  tc_volume_index_to_lps(volume, hi, b);
  for (int k = 0; k < 3; k++) sum += (b[k] - a[k]) * (b[k] - a[k]);
  return sqrt(sum);
}

int tc_fit_axis(const tc_volume *volume) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  double extent[3] = {0};
  for (int k = 0; k < 3; k++)
    for (int j = 0; j < 3; j++)
      extent[k] += fabs(d->direction[3 * k + j]) * d->spacing[j] * (d->dims[j] > 1 ? d->dims[j] - 1 : 1);
  if (extent[2] < THIN * fmin(extent[0], extent[1])) return 2;
  return extent[0] < THIN * fmin(extent[1], extent[2]) ? 0 : 1;
}

/* By axis: direction from the target to the eye, and up. */
static const double views[3][2][3] = {{{1, 0, 0}, {0, 0, 1}}, {{0, -1, 0}, {0, 0, 1}}, {{0, 0, -1}, {0, -1, 0}}};

static void fit_camera(tc_camera *camera, const tc_volume *volume) {
  double lo[3], hi[3], mid[3], corner[3], p[3], radius = 0;
  const double (*view)[3] = views[tc_fit_axis(volume)];
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
  memcpy(camera->up, view[1], sizeof camera->up);
  /* The bounding sphere fits, so that the volume can be rotated. */
  double distance = radius / sin(camera->fov_y_deg * M_PI / 360);
  for (int k = 0; k < 3; k++) camera->position[k] = camera->target[k] + distance * view[0][k];
  camera->height_mm = 2 * radius;
}

/* ---- values ---- */

/* A CT whose values were not rescaled has no Hounsfield units. */
static bool is_hounsfield(const tc_volume *volume, double low, double high) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  return (!strcmp(d->modality, "CT") || !strcmp(d->unit, "HU") || low < -500) && low < -100 && high > 300;
}

static const char *preset_for(const tc_volume *volume, const tc_values *values, const tc_fit *fit) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  if (!strcmp(d->modality, "XA")) return "vessels";
  if (!strcmp(d->format, "demo") && !strcmp(d->modality, "CT")) return "ct-head";
  if (fit->hounsfield) {
    const double bone = tc_values_share(values, BONE_HU), dense = tc_values_share(values, DENSE_HU);
    return bone > HEAD_BONE * dense ? "ct-head" : "ct-chest-contrast";
  }
  if (!strcmp(d->modality, "MR")) return "mr-default";
  return "surface";
}

/* hi; if the range is empty, lo plus 1 or 0.1 % of lo, so that the range has a width. */
static double above(double lo, double hi) { return hi - lo > 1e-6 * fabs(lo) ? hi : lo + fmax(1, 1e-3 * fabs(lo)); }

/* True if a window shows the body: little of the body is white, and its greys differ. If only specks are dense, as in
 * PET, there is no body to judge by. */
static bool shows_body(const tc_fit *fit, const tc_values *values, double center, double width) {
  const double dense = tc_values_share(values, fit->dense), white = tc_values_share(values, center + 0.5 * width);
  const double from = tc_values_percentile(values, fit->dense, 0.05), to = tc_values_percentile(values, fit->dense, 0.95);
  if (dense < LEAST_BODY || !(to > from)) return true;
  return white <= MOST_WHITE * dense && to > center - 0.5 * width && to - from >= LEAST_GREYS * width;
}

/* The window for slices: the file's own, else a usual one for Hounsfield units, else the range of the values. Other
 * modes get theirs from tc_fit_windows(). */
static void find_window(tc_fit *fit, const tc_volume *volume, const tc_values *values) {
  static const char *const names[] = {"ct-soft-tissue", "ct-bone"};
  const tc_volume_desc *d = tc_volume_describe(volume);
  const double lo = tc_values_percentile(values, fit->stretch.low, 0.001);
  const double hi = above(lo, tc_values_percentile(values, fit->stretch.low, 0.999));
  double center = d->window_center, width = d->window_width;
  for (size_t i = 0; fit->hounsfield && i < G_N_ELEMENTS(names); i++) {
    if (width > 0 && shows_body(fit, values, center, width)) break;
    const tc_window_preset *usual = tc_window_preset_named(names[i]);
    center = usual->center, width = usual->width;
  }
  if (!(width > 0) || !shows_body(fit, values, center, width)) center = 0.5 * (lo + hi), width = hi - lo;
  for (int mode = 0; mode < TC_MODE_COUNT; mode++) fit->windows[mode].center = center, fit->windows[mode].width = width;
}

static int by_value(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Background value, the median on the volume's six faces: air, the medium in a container or the zero of a map. */
static double value_around(const tc_volume *volume) {
  const int *dims = tc_volume_describe(volume)->dims;
  double values[6 * FACE_SIDE * FACE_SIDE];
  size_t count = 0;
  for (int face = 0; face < 6; face++)
    for (int i = 0; i < FACE_SIDE * FACE_SIDE; i++) {
      double at[3];
      at[face / 2] = face % 2 ? dims[face / 2] - 1 : 0;
      at[(face / 2 + 1) % 3] = i % FACE_SIDE * (dims[(face / 2 + 1) % 3] - 1) / (FACE_SIDE - 1);
      at[(face / 2 + 2) % 3] = i / FACE_SIDE * (dims[(face / 2 + 2) % 3] - 1) / (FACE_SIDE - 1);
      if (tc_volume_value_at(volume, at, &values[count])) count++;
    }
  qsort(values, count, sizeof *values, by_value);
  return count ? values[count / 2] : -INFINITY;
}

/* A preset without a unit starts at the background value. Not for MR, whose field of view often ends inside the
 * patient. */
static void begin_around(tc_fit *fit, const tc_volume *volume) {
  const double around = value_around(volume);
  if (fit->hounsfield || !strcmp(tc_volume_describe(volume)->modality, "MR")) return;
  if (around > fit->stretch.low && around < fit->stretch.middle) fit->stretch.low = around;
}

void tc_fit_find(tc_fit *fit, const tc_volume *volume) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  const double scale = diagonal_of(volume) / PRESET_DIAGONAL_MM;
  memset(fit, 0, sizeof *fit);
  fit->stretch = (tc_stretch){s->min, s->min, above(s->min, s->max), scale > 0 ? scale : 1};
  fit->preset = "grey-ramp";
  tc_values *values = tc_values_of(volume);
  if (!values) return;
  tc_values_range(values, &fit->stretch.low, &fit->stretch.high);
  if (s->max - fit->stretch.high < 1e-4 * (s->max - s->min)) fit->stretch.high = s->max; /* equal up to rounding */
  if (fit->stretch.high > fit->stretch.low) fit->stretch.middle = tc_values_threshold(values);
  else fit->stretch.high = fit->stretch.middle = above(fit->stretch.low, fit->stretch.low); /* there is nothing to see */
  fit->hounsfield = is_hounsfield(volume, fit->stretch.low, fit->stretch.high);
  fit->dense = fit->hounsfield ? DENSE_HU : fit->stretch.middle;
  fit->surface = fit->hounsfield ? BONE_HU : fit->stretch.middle;
  fit->preset = preset_for(volume, values, fit);
  find_window(fit, volume, values);
  begin_around(fit, volume);
  tc_values_free(values);
}

tc_volume *tc_fit_body(const tc_fit *fit, const tc_volume *volume, bool (*goes_on)(void *user),
                       bool (*reserve)(void *user, uint64_t bytes), void *user) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  const char *modality = tc_volume_describe(volume)->modality;
  const bool may_be_ct = !*modality || !strcmp(modality, "CT"), padded = s->max > fit->stretch.high;
  const double low = fit->stretch.low, soft = low + SOFT * (fit->stretch.middle - low);
  const tc_body_options options = {.soft = fit->hounsfield ? fit->dense : soft,
                                   .dense = fit->dense,
                                   .most = fit->stretch.high,
                                   .parts = fit->hounsfield || padded || may_be_ct, /* scanners pad */
                                   .strict = !fit->hounsfield,
                                   .air = fit->hounsfield ? AIR_HU : fit->stretch.low,
                                   .goes_on = goes_on,
                                   .reserve = reserve,
                                   .user = user};
  return tc_body_of(volume, &options);
}

/* ---- scenes ---- */

/* Shows all voxels of a model, coloured by its attribute "label" if it has one. */
static void show_model(tc_scene *scene, const tc_volume *volume) {
  const tc_volume_stats *s = tc_volume_statistics(volume);
  scene->mode = TC_MODE_SPLAT;
  scene->splat.threshold[0] = s->min, scene->splat.threshold[1] = s->max;
  if (tc_vmd_attribute_named(&((const tc_vmd *)tc_volume_model(volume))->head, "label"))
    g_strlcpy(scene->splat.attribute, "label", sizeof scene->splat.attribute);
}

static void fit_scene(tc_scene *scene, const tc_volume *volume, const tc_fit *fit) {
  fit_camera(&scene->camera, volume);
  scene->window.center = fit->windows[TC_MODE_MPR].center;
  scene->window.width = fit->windows[TC_MODE_MPR].width;
  scene->isosurface.value = fit->surface;
  scene->splat.threshold[0] = fit->surface;
  scene->splat.threshold[1] = fmax(fit->surface, tc_volume_statistics(volume)->max);
  memcpy(scene->mpr.center, scene->camera.target, sizeof scene->mpr.center);
  tc_transfer_function_fit_preset(&scene->transfer_function, fit->preset, &fit->stretch);
  if (tc_volume_sparse(volume)) show_model(scene, volume);
}

void tc_scene_fit(tc_scene *scene, const tc_volume *volume) {
  tc_fit fit;
  tc_fit_find(&fit, volume);
  fit.stretch.unit = 1;
  fit_scene(scene, volume, &fit);
}

void tc_scene_dress(tc_scene *scene, const tc_volume *volume, const tc_fit *fit, bool has_body) {
  fit_scene(scene, volume, fit);
  tc_scene_light(scene, tc_volume_sparse(volume) || tc_preset_named(fit->preset)->lit);
  scene->hide_table = has_body;
}
