#include "renderer/splat/pick.h"

#include <math.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/raycast/rays.h"
#include "renderer/splat/splatter.h"

#define MOST_WIDER 8 /* voxels: limit on the widening of a core to a pixel's width */
#define WIDEST (MOST_WIDER + 2.0)

/* A ray in index coordinates: at + t * along, t in mm from the eye. */
typedef struct pick {
  const tc_volume *volume;
  const tc_scene *scene;
  const int *dims;
  bool labels; /* the volume is a label map */
  double at[3], along[3];
  double pixel[2];         /* perspective: pixel position from the picture's middle; orthographic: 0, the ray starts at the pixel */
  double from, to;         /* range of t within the volume's box, widened by the largest core */
  tc_splat_frame frame;
  tc_vmd_object *object;   /* NULL for labels and run-length models: their normals come from the filled voxels around */
} pick;

static void set_ray(pick *p, const double at[2]) {
  tc_rays rays;
  double view[3], length = 0;
  tc_rays_set_up(&rays, p->volume, p->scene, p->scene->image.width, p->scene->image.height);
  for (int k = 0; k < 3; k++) {
    view[k] = rays.view0[k] + at[0] * rays.view_du[k] + at[1] * rays.view_dv[k];
    length += view[k] * view[k];
  }
  length = sqrt(length);
  const double eye = rays.perspective ? length : rays.eye_mm;
  for (int r = 0; r < 3; r++) {
    p->along[r] = 0;
    for (int k = 0; k < 3; k++) p->along[r] += rays.to_index[3 * r + k] * view[k] / length;
    p->at[r] = rays.anchor0[r] + at[0] * rays.anchor_du[r] + at[1] * rays.anchor_dv[r] - eye * p->along[r];
  }
  p->pixel[0] = rays.perspective ? at[0] - 0.5 * p->scene->image.width : 0;
  p->pixel[1] = rays.perspective ? at[1] - 0.5 * p->scene->image.height : 0;
  p->from = 0, p->to = 1e30;
  for (int k = 0; k < 3; k++) {
    const double lo = (-WIDEST - p->at[k]) / p->along[k], hi = (p->dims[k] - 1 + WIDEST - p->at[k]) / p->along[k];
    if (p->along[k] == 0) continue;
    p->from = fmax(p->from, fmin(lo, hi));
    p->to = fmin(p->to, fmax(lo, hi));
  }
}

static bool is_filled(const pick *p, double value) {
  const tc_scene *s = p->scene;
  if (!p->labels) return value >= s->splat.threshold[0] && value <= s->splat.threshold[1];
  bool shown = !s->labels.visible;
  for (size_t i = 0; i < s->labels.n_visible && !shown; i++) shown = s->labels.visible[i] == value;
  return value > 0 && shown;
}

/* Beyond the grid: the value at its nearest side. */
static bool filled_at(const pick *p, const int voxel[3], double *value) {
  double at[3];
  for (int k = 0; k < 3; k++) at[k] = MIN(MAX(voxel[k], 0), p->dims[k] - 1);
  return tc_volume_value_at(p->volume, at, value) && is_filled(p, *value);
}

/* True if a face is free but no two opposite ones: a surface, neither interior nor thin. */
static bool is_surface(const pick *p, const int voxel[3]) {
  double value;
  int faces = 0;
  for (int k = 0; k < 3; k++) {
    int before[3] = {voxel[0], voxel[1], voxel[2]}, behind[3] = {voxel[0], voxel[1], voxel[2]};
    before[k]--, behind[k]++;
    const bool free[2] = {!filled_at(p, before, &value), !filled_at(p, behind, &value)};
    if (free[0] && free[1]) return false;
    faces += free[0] || free[1];
  }
  return faces > 0;
}

/* Normal and distance of the surface from the 5x5x5 voxels around a voxel. */
static double filled_normal(const pick *p, const int voxel[3], double normal[3]) {
  int sum[3] = {0}, filled = 0;
  for (int i = 0; i < 125; i++) {
    const int step[3] = {i % 5 - 2, i / 5 % 5 - 2, i / 25 - 2};
    double value;
    if (!filled_at(p, (int[]){voxel[0] + step[0], voxel[1] + step[1], voxel[2] + step[2]}, &value)) continue;
    filled++;
    for (int k = 0; k < 3; k++) sum[k] -= step[k];
  }
  return tc_splats_filled_normal(tc_volume_describe(p->volume), sum, filled, normal);
}

/* Normal and inset distance of the voxel's splat: find_normal() of splats.c. */
static double normal_of(const pick *p, const int voxel[3], double normal[3]) {
  double own[3] = {0}, inset = -1;
  if (p->object) inset = tc_vmd_normal_at(p->object, voxel[0], voxel[1], voxel[2], own);
  if (inset < 0) inset = fmax(filled_normal(p, voxel, normal), 0);
  if (!p->object && !p->labels) tc_vmd_own_normal(tc_volume_model(p->volume), voxel[0], voxel[1], voxel[2], own);
  if (dot3(own, own) > 0) memcpy(normal, own, sizeof own);
  return dot3(normal, normal) > 0 ? inset : -1;
}

/* Sets the axis, length along it, and offsets of the centre and the surface of a surface's kernel: set_shape() of shape_tmpl.h.
 * False: the kernel is a ball. Thin voxels are treated as balls, which are easier to hit. */
static bool shape_of(const pick *p, const int voxel[3], double axis[3], double *flat, double move[2]) {
  const tc_splat_args *g = &p->frame.args;
  double n[3];
  if (!(g->shape_blend > 0) || !is_surface(p, voxel)) return false;
  const double inset = normal_of(p, voxel, n);
  if (inset < 0) return false;
  for (int k = 0; k < 3; k++)
    axis[k] = (double)g->covariant[k][0] * n[0] + (double)g->covariant[k][1] * n[1] + (double)g->covariant[k][2] * n[2];
  normalise3(axis);
  *flat = 1 + ((double)TC_SPLAT_FLAT - 1) * (double)g->shape_blend;
  move[1] = (double)g->shape_blend * fmin(inset, 1);
  move[0] = move[1] - (double)(TC_SPLAT_FLAT * g->core_radius * g->shape_blend);
  return true;
}

/* core_of() of shape_tmpl.h; to: direction from the eye. */
static double core_of(const double to[3], const double axis[3], double flat) {
  const double cosine = fabs(dot3(to, axis)) / sqrt(dot3(to, to)), aslant = (double)TC_SPLAT_ASLANT;
  const double most = fmax(fmin(flat / (double)TC_SPLAT_FLAT, 1), flat);
  return flat + (most - flat) * fmin(fmax((cosine - aslant) / aslant, 0), 1);
}

/* True if a kernel's core covers the pixel's centre: project() of tile_tmpl.h. to: the kernel's centre in index coordinates, relative
 * to the eye (orthographic: to the start of the ray). */
static bool holds(const pick *p, const double to[3], const double axis[3], double flat) {
  const tc_splat_args *g = &p->frame.args;
  double view[3] = {0}, off[2], xx = 0, yy = 0, xy = 0, area = 0, rows[2][3];
  for (int r = 0; r < 3; r++)
    for (int k = 0; k < 3; k++) view[r] += (double)g->axis[r][k] * to[k];
  const double scale = (double)g->scale / (g->perspective ? view[2] : 1);
  for (int r = 0; r < 2; r++) {
    const double slope = g->perspective ? view[r] / view[2] : 0;
    off[r] = view[r] * scale - p->pixel[r];
    for (int k = 0; k < 3; k++) rows[r][k] = scale * ((double)g->axis[r][k] - slope * (double)g->axis[2][k]);
    const double more = (flat - 1) * dot3(rows[r], axis);
    for (int k = 0; k < 3; k++) rows[r][k] += more * axis[k];
  }
  for (int k = 0; k < 3; k++) {
    const int l = (k + 1) % 3;
    const double across = rows[0][l] * rows[1][k] - rows[0][k] * rows[1][l];
    xx += rows[0][k] * rows[0][k], yy += rows[1][k] * rows[1][k], xy += rows[0][k] * rows[1][k], area += across * across;
  }
  const double size = (double)g->radius2, least = (double)g->pixel_radius2;
  const double whole = area * size * size + least * ((xx + yy) * size + least);
  const double q = (yy * size + least) * off[0] * off[0] - 2 * xy * size * off[0] * off[1] + (xx * size + least) * off[1] * off[1];
  return q <= (double)g->core2 * whole;
}

/* except: index of a plane to ignore, or -1. */
static bool kept_by_planes(const pick *p, const double at[3], int except) {
  const tc_splat_args *g = &p->frame.args;
  for (int i = 0; i < g->n_planes; i++)
    if (i != except && dot3(g->planes[i], at) + g->planes[i][3] < 0) return false;
  return true;
}

/* True if the ray hits the voxel's cut face on plane i: a neighbour of the voxel is clipped by the plane, and the hit is kept by the
 * other planes and lies at most `out` along the axis from the voxel. */
static bool meets_face(const pick *p, const int voxel[3], int i, const double axis[3], double out) {
  const double *const plane = p->frame.args.planes[i];
  const double at[3] = {voxel[0], voxel[1], voxel[2]}, away = dot3(plane, at) + plane[3];
  if (!(away - fmax(fabs(plane[0]), fmax(fabs(plane[1]), fabs(plane[2]))) < 0)) return false;
  const double t = -(dot3(plane, p->at) + plane[3]) / dot3(plane, p->along);
  double on[3], from[3];
  for (int k = 0; k < 3; k++) on[k] = p->at[k] + t * p->along[k], from[k] = on[k] - at[k];
  return kept_by_planes(p, on, i) && !(dot3(axis, from) > out);
}

/* True if the ray hits a cut face of the voxel. out: distance of the surface along the axis. */
static bool hits_cut_face(const pick *p, const int voxel[3], const double axis[3], double out) {
  bool open = false;
  for (int i = 0; i < p->frame.args.n_planes; i++) open |= meets_face(p, voxel, i, axis, out);
  return open && kept_by_planes(p, (double[]){voxel[0], voxel[1], voxel[2]}, -1);
}

/* True if the planes keep the part of the voxel's kernel that the ray hits; on a surface that faces the eye, `out` along the axis, the
 * planes clip per pixel (cut_tmpl.h). to: from the start of the ray to the voxel. */
static bool is_kept(const pick *p, const int voxel[3], const double to[3], bool shaped, const double axis[3], double out) {
  const double facing = dot3(axis, p->along);
  if (!p->frame.args.n_planes) return true;
  if (!shaped || facing > -0.1 * length3(p->along)) return kept_by_planes(p, (double[]){voxel[0], voxel[1], voxel[2]}, -1);
  double at[3];
  for (int k = 0; k < 3; k++) at[k] = p->at[k] + (dot3(axis, to) + out) / facing * p->along[k];
  return kept_by_planes(p, at, -1) || hits_cut_face(p, voxel, axis, out / fmax((double)p->frame.args.shape_blend, 1e-3));
}

/* True if a plane that faces the eye clips `next`, a neighbour of the voxel. */
static bool faces_a_cut(const pick *p, const int next[3], const double to_eye[3]) {
  const double at[3] = {next[0], next[1], next[2]};
  bool any = false;
  for (int i = 0; i < p->frame.args.n_planes; i++) {
    const double *plane = p->frame.args.planes[i];
    any |= dot3(plane, at) + plane[3] < 0 && dot3(plane, to_eye) < 0;
  }
  return any;
}

/* True if the voxel's splat faces the eye: project() of tile_tmpl.h. A free face or a cut face faces the eye, or the surface does.
 * front: the surface faces the eye or is unknown. */
static bool is_seen(const pick *p, const int voxel[3], const double to_eye[3], bool front) {
  const int brick[3] = {voxel[0] / TC_SPLAT_BRICK, voxel[1] / TC_SPLAT_BRICK, voxel[2] / TC_SPLAT_BRICK};
  const unsigned aslant = p->frame.args.shape_blend > 0 ? tc_splat_aslant(p->frame.eye, brick) : 0;
  const bool kept = kept_by_planes(p, (double[]){voxel[0], voxel[1], voxel[2]}, -1);
  for (int face = 0; face < 6; face++) {
    const int k = face / 2, side = face & 1 ? 1 : -1;
    const bool shows = to_eye[k] * side > 0.5;
    int next[3] = {voxel[0], voxel[1], voxel[2]};
    double value;
    if (!shows && !(aslant >> face & 1)) continue;
    next[k] += side;
    if (shows && (next[k] < 0 || next[k] == p->dims[k])) return true; /* the grid's side cuts it */
    if ((shows || front) && !filled_at(p, next, &value)) return true;
    if (!kept || kept_by_planes(p, (double[]){next[0], next[1], next[2]}, -1)) continue;
    if (shows || faces_a_cut(p, next, to_eye)) return true;
  }
  return false;
}

/* True if the voxel's splat is drawn and its core covers the pixel's centre. Sets the voxel's value and the distance of the drawn
 * surface, mm. */
static bool meets(const pick *p, const int voxel[3], double *t, double *value) {
  const tc_splat_args *g = &p->frame.args;
  double axis[3] = {0}, flat = 1, move[2] = {0}, from[3], to[3], to_eye[3], deep = 0, deeper = 0, near = 0;
  if (!filled_at(p, voxel, value)) return false;
  for (int k = 0; k < 3; k++) from[k] = voxel[k] - p->at[k], to_eye[k] = p->frame.eye[k] - voxel[k];
  const bool shaped = shape_of(p, voxel, axis, &flat, move);
  if (g->opaque && !is_seen(p, voxel, to_eye, !shaped || dot3(axis, to_eye) > 0)) return false;
  if (shaped) flat = core_of(g->perspective ? from : p->along, axis, flat);
  if (!is_kept(p, voxel, from, shaped, axis, move[1])) return false;
  for (int k = 0; k < 3; k++) {
    to[k] = from[k] + move[0] * axis[k];
    near += (double)g->axis[2][k] * to[k];
    deep += (double)g->axis[2][k] * (from[k] + move[1] * axis[k]), deeper += (double)g->axis[2][k] * p->along[k];
  }
  *t = deep / deeper;
  return *t > 0 && near > 0 && holds(p, to, axis, flat);
}

/* Largest distance from the ray, at t mm from the eye, of voxels whose cores cover the pixel's centre. */
static double reach_at(const pick *p, double t) {
  const tc_splat_args *g = &p->frame.args;
  const double *spacing = tc_volume_describe(p->volume)->spacing;
  double deep = 0;
  for (int k = 0; k < 3; k++) deep += fmax(t, 0) * (double)g->axis[2][k] * p->along[k];
  const double pixel = (g->perspective ? deep : 1) / (double)g->scale / fmin(spacing[0], fmin(spacing[1], spacing[2]));
  return (double)(g->core_radius + g->shape_blend) + fmin(sqrt((double)(g->pixel_radius2 * g->core2)) * pixel, MOST_WIDER);
}

/* Tests the voxels within reach of the ray's position at t; updates the hit by nearer ones. */
static void look_around(const pick *p, double t, double reach, tc_splat_hit *hit) {
  int lo[3], hi[3];
  for (int k = 0; k < 3; k++) {
    const double at = p->at[k] + t * p->along[k];
    lo[k] = (int)fmax(ceil(at - reach), 0), hi[k] = (int)fmin(floor(at + reach), p->dims[k] - 1);
  }
  for (int z = lo[2]; z <= hi[2]; z++)
    for (int y = lo[1]; y <= hi[1]; y++)
      for (int x = lo[0]; x <= hi[0]; x++) {
        double at, value;
        if (!meets(p, (int[]){x, y, z}, &at, &value) || at >= hit->distance_mm) continue;
        *hit = (tc_splat_hit){.voxel = {x, y, z}, .value = value, .distance_mm = at};
      }
}

bool tc_splat_pick(const tc_volume *of, const tc_volume *labels, const tc_scene *scene, const double at[2],
                   tc_splat_hit *hit) {
  const tc_volume *volume = labels ? labels : of;
  const tc_splats none = {.sides = 63};
  tc_frame frame = {.width = scene->image.width, .height = scene->image.height};
  const tc_splat_job job = {.volume = volume, .splats = &none, .scene = scene, .frame = &frame};
  pick p = {.volume = volume, .labels = labels != NULL, .scene = scene, .dims = tc_volume_describe(volume)->dims};
  *hit = (tc_splat_hit){.distance_mm = INFINITY};
  if (!tc_splat_frame_begin(&p.frame, &job, NULL)) return false;
  if (!labels && !tc_volume_sparse(volume))
    p.object = tc_vmd_object_new(volume, scene->splat.threshold[0], scene->splat.threshold[1]);
  set_ray(&p, at);
  const double voxels_a_mm = length3(p.along);
  /* Steps of a reach: voxels that far from the ray are within 1.12 of it from a step. A nearer hit may be found up to a
   * reach behind the first one. */
  for (double t = p.from, reach = 0; t <= p.to && t <= hit->distance_mm + reach / voxels_a_mm; t += reach / voxels_a_mm) {
    reach = reach_at(&p, t);
    look_around(&p, t, 1.12 * reach, hit);
  }
  tc_vmd_object_free(p.object);
  tc_splat_frame_end(&p.frame);
  if (!isfinite(hit->distance_mm)) return false;
  tc_volume_index_to_lps(volume, (double[]){hit->voxel[0], hit->voxel[1], hit->voxel[2]}, hit->position);
  return true;
}
