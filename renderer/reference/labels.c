/* Labels along a ray: stretches of the field are also cut where the ray passes from one cell of the labels' grid to
 * the next. In between, visibility and tint are the trilinear means of the entries of eight labels, hence cubics
 * along the ray. */
#include <math.h>
#include <string.h>

#include "renderer/reference/internal.h"
#include "renderer/volume/provenance.h"

#define NEAR 1e-9 /* label voxels: a plane this close counts as passed */

void tc_ref_labels_set_up(tc_ref_labels *l, const tc_volume *labels, const tc_scene *scene) {
  const tc_volume_desc *d = tc_volume_describe(labels);
  double axis[3][3];
  l->desc = d;
  l->volume = labels;
  l->voxels = tc_volume_data(labels);
  l->scene = scene;
  l->nearest = scene->filter == TC_FILTER_NEAREST;
  for (int k = 0; k < 3; k++)
    for (int r = 0; r < 3; r++) axis[k][r] = d->direction[3 * r + k] * d->spacing[k];
  for (int k = 0; k < 3; k++) {
    const double *a = axis[(k + 1) % 3], *b = axis[(k + 2) % 3];
    double mm3 = 0;
    for (int r = 0; r < 3; r++) l->dual[k][r] = a[(r + 1) % 3] * b[(r + 2) % 3] - a[(r + 2) % 3] * b[(r + 1) % 3];
    for (int r = 0; r < 3; r++) mm3 += l->dual[k][r] * axis[k][r];
    for (int r = 0; r < 3; r++) l->dual[k][r] /= mm3;
  }
}

void tc_ref_labels_of_gaps(tc_ref_labels *l, const tc_volume *gaps, tc_scene *scene) {
  scene->labels.visible = g_new0(uint32_t, 1); /* what is no gap is 0 */
  scene->labels.n_visible = 1;
  tc_ref_labels_set_up(l, gaps, scene);
}

double tc_ref_label_at(const tc_volume_desc *d, const void *voxels, const int at[3]) {
  for (int k = 0; k < 3; k++)
    if (at[k] < 0 || at[k] >= d->dims[k]) return 0;
  size_t i = ((size_t)at[2] * (size_t)d->dims[1] + (size_t)at[1]) * (size_t)d->dims[0] + (size_t)at[0];
  double voxel = d->type == TC_U8    ? ((const uint8_t *)voxels)[i]
                 : d->type == TC_I8  ? ((const int8_t *)voxels)[i]
                 : d->type == TC_U16 ? ((const uint16_t *)voxels)[i]
                                     : ((const int16_t *)voxels)[i];
  return fmax(d->slope * voxel + d->intercept, 0);
}

/* Tint (premultiplied), its opacity and visibility of one label. */
static void look_up(const tc_ref_labels *l, double label, double out[5]) {
  const tc_scene *s = l->scene;
  size_t count, n = (size_t)label;
  const double(*palette)[3] = tc_label_palette(&count), *rgb = n > 0 ? palette[(n - 1) % count] : palette[0];
  double opacity = n > 0;
  bool shown = !s->labels.visible;
  const tc_segment *segment = tc_volume_segment(l->volume, (uint32_t)n);
  double own[3];
  if (segment && segment->has_color) {
    for (int c = 0; c < 3; c++) own[c] = (double)segment->color[c];
    rgb = own;
  }
  for (size_t i = 0; i < s->labels.n_visible && !shown; i++) shown = s->labels.visible[i] == n;
  for (size_t i = 0; i < s->labels.n_colors; i++)
    if (s->labels.colors[i].label == n) rgb = s->labels.colors[i].rgba, opacity = rgb[3];
  opacity *= shown ? s->labels.opacity : 0;
  for (int c = 0; c < 3; c++) out[c] = opacity * (s->image.linear_light ? tc_ref_to_linear(rgb[c]) : rgb[c]);
  out[3] = opacity;
  out[4] = shown;
}

bool tc_ref_label_color(const tc_volume *labels, const tc_scene *scene, double label, double rgb[3]) {
  const tc_ref_labels l = {.volume = labels, .scene = scene};
  double tint[5];
  look_up(&l, label, tint);
  for (int c = 0; c < 3 && tint[3] > 0; c++) rgb[c] = tint[c] / tint[3];
  return tint[3] > 0;
}

/* The u at which the stretch of `whole` that begins at u = from leaves its cell of the labels' grid; *cell is that
 * cell. */
static double find_cell(const tc_ref_labels *l, const tc_ref_ray *ray, const tc_ref_cell *whole, double from,
                        tc_ref_label_cell *cell) {
  double at[3], rate[3], to = 1;
  int low[3], step[3];
  for (int k = 0; k < 3; k++) {
    at[k] = rate[k] = 0;
    for (int r = 0; r < 3; r++) {
      double t = whole->from + from * whole->length;
      at[k] += l->dual[k][r] * (ray->lps[r] + t * ray->lps_direction[r] - l->desc->origin[r]);
      rate[k] += l->dual[k][r] * ray->lps_direction[r] * whole->length;
    }
    step[k] = !l->nearest && l->desc->dims[k] > 1;
    double shifted = step[k] ? at[k] : at[k] + 0.5; /* cells end at voxel centres; for nearest at voxel faces */
    double plane = rate[k] > 0 ? floor(shifted + NEAR) + 1 : ceil(shifted - NEAR) - 1;
    if (fabs(rate[k]) > 1e-15) to = fmin(to, from + (plane - shifted) / rate[k]);
  }
  if (1 - to < 1e-12) to = 1;
  for (int k = 0; k < 3; k++) {
    double middle = at[k] + 0.5 * (to - from) * rate[k];
    low[k] = (int)floor(step[k] ? middle : middle + 0.5 + NEAR);
    cell->start[k] = step[k] ? at[k] - low[k] : 0;
    cell->delta[k] = step[k] ? rate[k] * (to - from) : 0;
  }
  for (int corner = 0; corner < 8; corner++) {
    int voxel[3];
    for (int k = 0; k < 3; k++) voxel[k] = low[k] + (corner >> k & 1) * step[k];
    look_up(l, tc_ref_label_at(l->desc, l->voxels, voxel), cell->corner[corner]);
  }
  return to;
}

bool tc_ref_labels_next(const tc_ref_labels *l, tc_ref_walk *walk, tc_ref_label_walk *labels, tc_ref_cell *cell) {
  if (labels->u >= 1) {
    if (!tc_ref_walk_next(walk, &labels->whole)) return false;
    labels->u = 0;
  }
  const tc_ref_cell *whole = &labels->whole;
  const double u = labels->u, to = find_cell(l, walk->ray, whole, u, &labels->cell), w = to - u;
  *cell = *whole;
  cell->from = whole->from + u * whole->length;
  cell->length = w * whole->length;
  tc_ref_shift(cell->c, cell->degree, u);
  double scale = w;
  for (int i = 1; i <= cell->degree; i++, scale *= w) cell->c[i] *= scale;
  for (int k = 0; k < 3; k++) {
    cell->start[k] = whole->start[k] + u * whole->delta[k];
    cell->delta[k] = w * whole->delta[k];
  }
  cell->label = &labels->cell;
  labels->u = to;
  return true;
}

double tc_ref_label_mean(const tc_ref_label_cell *cell, double u, double tint[4]) {
  double visible = 0;
  memset(tint, 0, 4 * sizeof *tint);
  for (int corner = 0; corner < 8; corner++) {
    double weight = 1;
    for (int k = 0; k < 3; k++) {
      double x = fmin(fmax(cell->start[k] + u * cell->delta[k], 0), 1);
      weight *= corner >> k & 1 ? x : 1 - x;
    }
    for (int c = 0; c < 4; c++) tint[c] += weight * cell->corner[corner][c];
    visible += weight * cell->corner[corner][4];
  }
  return visible;
}

void tc_ref_label_tint(const tc_ref_label_cell *cell, double u, double rgb[3]) {
  double tint[4], visible = tc_ref_label_mean(cell, u, tint);
  if (!(visible > 0)) return;
  for (int c = 0; c < 3; c++) rgb[c] = rgb[c] * (1 - tint[3] / visible) + tint[c] / visible;
}
