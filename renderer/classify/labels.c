#include "renderer/classify/labels.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/clock.h"
#include "renderer/classify/preintegration.h"
#include "renderer/classify/transfer.h"
#include "renderer/volume/provenance.h"

#define POLL 4096 /* labels between two polls of the halt */

static atomic_uint_fast64_t last_serial;

bool tc_mode_has_labels(tc_mode mode) {
  return mode == TC_MODE_DVR || mode == TC_MODE_MPR || mode == TC_MODE_MESH || mode == TC_MODE_SPLAT;
}

/* ---- colours ---- */

/* The seven colours of Okabe and Ito, distinguishable with any colour vision (jfly.uni-koeln.de/color, 2008), ordered
 * so that neighbours differ strongly; then the same colours lightened half way to white, and darkened. */
const double (*tc_label_palette(size_t *count))[3] {
  static const double palette[TC_LABEL_PALETTE][3] = {
      {0.902, 0.624, 0.000}, {0.337, 0.706, 0.914}, {0.000, 0.620, 0.451}, {0.835, 0.369, 0.000}, {0.800, 0.475, 0.655},
      {0.000, 0.447, 0.698}, {0.941, 0.894, 0.259}, {0.951, 0.812, 0.500}, {0.669, 0.853, 0.957}, {0.500, 0.810, 0.726},
      {0.918, 0.685, 0.500}, {0.900, 0.738, 0.828}, {0.500, 0.724, 0.849}, {0.971, 0.947, 0.630}, {0.541, 0.374, 0.000},
      {0.202, 0.424, 0.548}, {0.000, 0.372, 0.271}, {0.501, 0.221, 0.000}, {0.480, 0.285, 0.393}, {0.000, 0.268, 0.419},
      {0.565, 0.536, 0.155}};
  *count = TC_LABEL_PALETTE;
  return palette;
}

static const double *listed_color(const tc_scene *scene, uint32_t label) {
  size_t lo = 0, hi = scene->labels.n_colors;
  while (lo < hi) {
    size_t middle = (lo + hi) / 2;
    if (scene->labels.colors[middle].label < label)
      lo = middle + 1;
    else
      hi = middle;
  }
  return lo < scene->labels.n_colors && scene->labels.colors[lo].label == label ? scene->labels.colors[lo].rgba : NULL;
}

static void fill_entry(float entry[8], uint32_t label, bool visible, const tc_segment *segment, const tc_scene *scene) {
  const double *listed = listed_color(scene, label), *rgb = listed;
  double opacity = listed ? listed[3] : label > 0, own[3];
  size_t count;
  if (!rgb && segment && segment->has_color) {
    for (int c = 0; c < 3; c++) own[c] = (double)segment->color[c];
    rgb = own;
  }
  if (!rgb) rgb = tc_label_palette(&count)[label > 0 ? (label - 1) % TC_LABEL_PALETTE : 0];
  opacity *= visible ? scene->labels.opacity : 0;
  bool linear = scene->image.linear_light && scene->mode != TC_MODE_MPR; /* slices composite in display space */
  for (int c = 0; c < 3; c++) {
    const double color = linear ? tc_srgb_to_linear(rgb[c]) : rgb[c];
    entry[c] = (float)(opacity * color);
    entry[5 + c] = (float)(label > 0 || listed ? color : 0);
  }
  entry[3] = (float)opacity;
  entry[4] = visible;
}

const tc_scene *tc_labels_of_gaps(void) {
  static uint32_t shown = 0;
  static const tc_scene scene = {.labels = {.visible = &shown, .n_visible = 1}};
  return &scene;
}

bool tc_labels_in_color(const tc_volume *volume, const tc_scene *s) {
  return tc_volume_colors(volume) && s->mode == TC_MODE_MPR && !s->labels.volume[0] && !(s->mpr.thickness_mm > 0);
}

const tc_scene *tc_labels_of_colors(void) {
  static const tc_scene scene = {.mode = TC_MODE_MPR, .labels = {.opacity = 1}};
  return &scene;
}

/* ---- the table ---- */

GBytes *tc_labels_key(const tc_volume *labels, const tc_scene *scene) {
  GByteArray *key = g_byte_array_new();
  const uint64_t numbers[] = {tc_volume_serial(labels), scene->labels.n_colors, scene->labels.n_visible,
                              scene->labels.visible != NULL, scene->image.linear_light && scene->mode != TC_MODE_MPR};
  g_byte_array_append(key, (const guint8 *)numbers, sizeof numbers);
  g_byte_array_append(key, (const guint8 *)&scene->labels.opacity, sizeof scene->labels.opacity);
  for (size_t i = 0; i < scene->labels.n_colors; i++) { /* member by member, because of padding */
    g_byte_array_append(key, (const guint8 *)&scene->labels.colors[i].label, sizeof(uint32_t));
    g_byte_array_append(key, (const guint8 *)scene->labels.colors[i].rgba, sizeof scene->labels.colors[i].rgba);
  }
  if (scene->labels.n_visible)
    g_byte_array_append(key, (const guint8 *)scene->labels.visible,
                        (guint)(scene->labels.n_visible * sizeof(uint32_t)));
  return g_byte_array_free_to_bytes(key);
}

bool tc_labels_show(const tc_scene *s, uint32_t label) {
  for (size_t i = 0; i < s->labels.n_visible && s->labels.visible; i++)
    if (s->labels.visible[i] == label) return true;
  return !s->labels.visible;
}

static int compare(const void *a, const void *b) {
  uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
  return (x > y) - (x < y);
}

/* False: halted. */
static bool fill_entries(tc_labels *l, const tc_volume *labels, const tc_scene *scene, const tc_halt *halt) {
  const tc_volume_desc *d = tc_volume_describe(labels);
  size_t count = scene->labels.n_visible;
  uint32_t *visible = g_memdup2(scene->labels.visible, count * sizeof *visible);
  if (count) qsort(visible, count, sizeof *visible, compare);
  bool left = false;
  for (int i = 0; i <= l->n && !left; i++) {
    left = i % POLL == 0 && tc_halt_within(halt);
    double value = i < l->n ? d->slope * (l->base + i) + d->intercept : 0;
    uint32_t label = value > 0 && value <= UINT32_MAX ? (uint32_t)value : 0;
    bool shown = !scene->labels.visible || (count && bsearch(&label, visible, count, sizeof label, compare));
    fill_entry(l->entries[i], label, shown, tc_volume_segment(labels, label), scene);
  }
  g_free(visible);
  return !left;
}

tc_labels *tc_labels_build(const tc_volume *labels, const tc_scene *scene, GBytes *key, const tc_halt *halt,
                           GError **error) {
  const tc_volume_stats *s = tc_volume_statistics(labels);
  double start = tc_now_ms();
  tc_labels *l = calloc(1, sizeof *l);
  if (l) {
    l->base = (int)s->voxel_min;
    l->n = (int)(s->voxel_max - s->voxel_min) + 1;
    l->entries = calloc((size_t)l->n + 1, sizeof *l->entries);
  }
  bool ok = l && l->entries;
  if (!ok)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "labels: out of memory");
  else
    ok = fill_entries(l, labels, scene, halt) || tc_halt_say(halt, error);
  if (!ok) {
    if (l) free(l->entries);
    free(l);
    g_bytes_unref(key);
    return NULL;
  }
  l->serial = atomic_fetch_add(&last_serial, 1) + 1;
  l->key = key;
  l->bytes = ((size_t)l->n + 1) * sizeof *l->entries + g_bytes_get_size(key);
  l->build_ms = tc_now_ms() - start;
  return l;
}

void tc_labels_free(tc_labels *labels) {
  if (!labels) return;
  g_bytes_unref(labels->key);
  free(labels->entries);
  free(labels);
}

/* ---- position ---- */

void tc_labels_matrix(const tc_volume *volume, const tc_volume *labels, double matrix[3][4]) {
  for (int column = 3; column >= 0; column--) { /* the offset first: the other columns subtract it */
    double index[3] = {column == 0, column == 1, column == 2}, lps[3], to[3];
    tc_volume_index_to_lps(volume, index, lps);
    tc_volume_lps_to_index(labels, lps, to);
    for (int r = 0; r < 3; r++) matrix[r][column] = to[r] - (column < 3 ? matrix[r][3] : 0);
  }
}

/* True if the bounding box of `a` in b's index space overlaps b's box. */
static bool meets(const tc_volume *a, const tc_volume *b) {
  double matrix[3][4], lo[3], hi[3], to_lo[3], to_hi[3];
  tc_labels_matrix(a, b, matrix);
  tc_volume_index_box(a, lo, hi);
  tc_volume_index_box(b, to_lo, to_hi);
  for (int r = 0; r < 3; r++) {
    double least = matrix[r][3], most = matrix[r][3];
    for (int k = 0; k < 3; k++) {
      least += fmin(matrix[r][k] * lo[k], matrix[r][k] * hi[k]);
      most += fmax(matrix[r][k] * lo[k], matrix[r][k] * hi[k]);
    }
    if (!(least <= to_hi[r] && most >= to_lo[r])) return false;
  }
  return true;
}

static bool does_not_fit(const char *name, const char *why, GError **error) {
  tc_set_error(error, TC_ERROR_INVALID, NULL, "%s: %s", name, why);
  return false;
}

bool tc_labels_fit(const tc_volume *volume, const tc_volume *labels, const char *name, GError **error) {
  const tc_volume_desc *d = tc_volume_describe(labels);
  if (tc_volume_sparse(labels)) return does_not_fit(name, "a volume with a grid expected, not a run-length model", error);
  if (d->type == TC_F32)
    return does_not_fit(name, "whole numbers of at most 16 bits expected, this volume holds f32: convert it", error);
  if (d->slope != rint(d->slope) || d->intercept != rint(d->intercept))
    return does_not_fit(name, "whole numbers of at most 16 bits expected, this volume holds fractions: convert it", error);
  if (!meets(volume, labels) || !meets(labels, volume))
    return does_not_fit(name, "it lies outside the volume in patient space: choose the one made for this volume", error);
  return true;
}

bool tc_labels_check(const tc_volume *volume, const tc_volume *labels, const tc_scene *scene, GError **error) {
  static const char pointer[] = "/labels/volume";
  if (!scene->labels.volume[0] || !tc_mode_has_labels(scene->mode)) return true;
  g_autoptr(GError) why = NULL;
  if (labels && tc_labels_fit(volume, labels, pointer + 1, &why)) return true;
  tc_set_error(error, TC_ERROR_INVALID, pointer, "%s", why ? why->message : "labels/volume: there is no such volume");
  return false;
}
