#include "renderer/base/vector.h"
#include "renderer/raycast/mpr.h"
#include "renderer/raycast/clip.h"

#include <math.h>
#include <string.h>

#define SLACK 1e-3 /* voxels */

void tc_slice_basis(const tc_scene *scene, double right[3], double up[3], double into[3]) {
  /* view, up: axial from the feet, coronal from the front, sagittal from the patient's left */
  static const double planes[TC_MPR_ORIENTATION_COUNT][2][3] = {[TC_AXIAL] = {{0, 0, 1}, {0, -1, 0}},
                                                                [TC_CORONAL] = {{0, 1, 0}, {0, 0, 1}},
                                                                [TC_SAGITTAL] = {{-1, 0, 0}, {0, 0, 1}}};
  bool oblique = scene->mpr.orientation == TC_OBLIQUE;
  const double *wanted_up = oblique ? scene->mpr.up : planes[scene->mpr.orientation][1];
  for (int k = 0; k < 3; k++) into[k] = oblique ? -scene->mpr.normal[k] : planes[scene->mpr.orientation][0][k];
  normalise3(into);
  cross3(into, wanted_up, right);
  normalise3(right);
  cross3(right, into, up);
}

/* Extent of the field along a unit vector in mm: the sum over the sides of a parallelepiped. */
static double extent(const tc_volume *volume, const double lo[3], const double hi[3], const double v[3]) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  double sum = 0;
  for (int k = 0; k < 3; k++) {
    double along = v[0] * d->direction[k] + v[1] * d->direction[3 + k] + v[2] * d->direction[6 + k];
    sum += fabs(along) * d->spacing[k] * (hi[k] - lo[k]);
  }
  return sum;
}

void tc_slice_rays(tc_rays *rays, const tc_volume *volume, const tc_scene *scene, int width, int height) {
  double right[3], up[3], center[3], mid[3], du[3], dv[3], corner[3];
  const double *spacing = tc_volume_describe(volume)->spacing;
  double least = fmin(spacing[0], fmin(spacing[1], spacing[2]));
  memset(rays, 0, sizeof *rays);
  rays->width = width, rays->height = height;
  tc_slice_basis(scene, right, up, rays->view0);
  tc_volume_lps_to_index_matrix(volume, rays->to_index);
  tc_volume_index_box(volume, rays->lo, rays->hi);
  double across = extent(volume, rays->lo, rays->hi, right), upward = extent(volume, rays->lo, rays->hi, up);
  double pixel = fmax(across / width, upward / height) / scene->mpr.zoom;
  for (int k = 0; k < 3; k++) mid[k] = 0.5 * (rays->lo[k] + rays->hi[k]);
  tc_volume_index_to_lps(volume, mid, center);
  if (scene->mpr.has_center) memcpy(center, scene->mpr.center, sizeof center);
  for (int k = 0; k < 3; k++) {
    du[k] = pixel * right[k];
    dv[k] = -pixel * up[k];
    corner[k] = center[k] - 0.5 * width * du[k] - 0.5 * height * dv[k];
    rays->lo[k] -= SLACK;
    rays->hi[k] += SLACK;
  }
  tc_volume_lps_to_index(volume, corner, rays->anchor0);
  for (int r = 0; r < 3; r++) {
    rays->anchor_du[r] = dot3(rays->to_index + 3 * r, du);
    rays->anchor_dv[r] = dot3(rays->to_index + 3 * r, dv);
  }
  tc_rays_add_clipping(rays, volume, scene);
  for (int i = 0; i < rays->n_planes; i++) rays->planes[i][3] += SLACK * least;
  rays->step_mm = scene->sampling.step * least;
  rays->eye_mm = 0.5 * scene->mpr.thickness_mm;
  rays->far_mm = scene->mpr.thickness_mm > 0 ? rays->eye_mm : SLACK * least;
}

/* A line of a slab in index coordinates: from + s * along, s in mm from the plane. */
typedef struct line {
  double from[3], along[3], start, end;
} line;

/* Keeps the part of the line where value + s * change >= 0. */
static void cut_line(line *l, double value, double change) {
  if (change > 0) l->start = fmax(l->start, -value / change);
  else if (change < 0) l->end = fmin(l->end, value / -change);
  else if (value < 0) l->end = -INFINITY;
}

static line line_at(const tc_rays *rays, const double at[2]) {
  line l = {.start = -rays->eye_mm, .end = rays->eye_mm};
  for (int k = 0; k < 3; k++) {
    l.from[k] = rays->anchor0[k] + at[0] * rays->anchor_du[k] + at[1] * rays->anchor_dv[k];
    l.along[k] = dot3(rays->to_index + 3 * k, rays->view0);
    cut_line(&l, l.from[k] - rays->lo[k], l.along[k]);
    cut_line(&l, rays->hi[k] - l.from[k], -l.along[k]);
  }
  for (int i = 0; i < rays->n_planes; i++)
    cut_line(&l, dot3(rays->planes[i], l.from) + rays->planes[i][3], dot3(rays->planes[i], l.along));
  return l;
}

#define MOST_PICKED 10000 /* samples of a pick: a scene may ask for millions, and nobody can stop a pick */

bool tc_slice_pick(const tc_volume *volume, const tc_scene *scene, const double at[2], tc_slice_hit *hit) {
  tc_rays rays;
  tc_slice_rays(&rays, volume, scene, scene->image.width, scene->image.height);
  const line l = line_at(&rays, at);
  const tc_slab_projection projection = scene->mpr.projection;
  double found = 0, sum = 0, seen = 0, place = 0, index[3];
  bool any = false, last = !(l.start < l.end);
  if (!(l.start <= l.end)) return false;
  const double step = fmax(rays.step_mm, (l.end - l.start) / MOST_PICKED);
  /* where the kernels sample: at both ends and at whole steps from the plane */
  for (double s = l.start, before = l.start, value, value_before = NAN;;) {
    for (int k = 0; k < 3; k++) index[k] = l.from[k] + s * l.along[k];
    if (!tc_volume_value_at(volume, index, &value)) value = NAN; /* a gap */
    if (value == value && (!any || (projection == TC_SLAB_MINIP ? value < found : value > found))) found = value, place = s;
    any |= value == value;
    if (value == value && value_before == value_before) sum += 0.5 * (s - before) * (value + value_before), seen += s - before;
    before = s, value_before = value;
    if (last) break;
    s = (floor(s / step + 1e-9) + 1) * step;
    last = s >= l.end;
    s = fmin(s, l.end);
  }
  if (!any) return false;
  if (projection == TC_SLAB_AVERAGE && seen > 0) found = sum / seen, place = 0.5 * (l.start + l.end);
  for (int k = 0; k < 3; k++) index[k] = l.from[k] + place * l.along[k];
  tc_volume_index_to_lps(volume, index, hit->position);
  hit->value = found, hit->depth_mm = place + rays.eye_mm;
  return true;
}
