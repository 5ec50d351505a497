#include "renderer/splat/pick.h"

#include <math.h>
#include <string.h>

#include "renderer/base/vector.h"
#include "renderer/raycast/rays.h"
#include "renderer/splat/splatter.h"

#define MOST_WIDER 3 /* voxels: most that a core is widened to a pixel's width */

/* A ray in index coordinates: at + t * along, t in mm from the eye. */
typedef struct pick {
  const tc_volume *volume;
  const tc_scene *scene;
  const int *dims;
  bool labels; /* the volume's values are */
  double at[3], along[3];
  double from, to;         /* mm within the volume's box, widened by a voxel */
  tc_splat_frame frame;    /* its kernels */
  tc_vmd_subject *subject; /* NULL: of labels and run-length models, whose normals are those of what is filled */
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
  p->from = 0, p->to = 1e30;
  for (int k = 0; k < 3; k++) {
    const double lo = (-1 - p->at[k]) / p->along[k], hi = (p->dims[k] - p->at[k]) / p->along[k];
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

static bool filled_at(const pick *p, const int voxel[3], double *value) {
  for (int k = 0; k < 3; k++)
    if (voxel[k] < 0 || voxel[k] >= p->dims[k]) return false;
  return tc_volume_value_at(p->volume, (double[]){voxel[0], voxel[1], voxel[2]}, value) && is_filled(p, *value);
}

/* Whether some face is free, and opposite ones are not: what is inside is drawn as it is, and so is what is thin. */
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

/* The normal of what is filled around the voxel. */
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

/* The normal and the surface's distance along it that the voxel's splat has (find_normal() of splats.c). */
static double normal_of(const pick *p, const int voxel[3], double normal[3]) {
  double own[3] = {0}, inset = -1;
  if (p->subject) inset = tc_vmd_normal_at(p->subject, voxel[0], voxel[1], voxel[2], own);
  if (inset < 0) inset = filled_normal(p, voxel, normal);
  if (!p->subject && !p->labels) tc_vmd_own_normal(tc_volume_model(p->volume), voxel[0], voxel[1], voxel[2], own);
  if (dot3(own, own) > 0) memcpy(normal, own, sizeof own);
  return dot3(normal, normal) > 0 ? inset : -1;
}

/* A surface's kernel as shape_of() of tile_tmpl.h has it: how flat along which axis, and how far it moves along it.
 * False: a ball; thin voxels count as balls, which are easier to hit. */
static bool shape_of(const pick *p, const int voxel[3], double axis[3], double *flat, double move[2]) {
  const tc_splat_args *g = &p->frame.args;
  double n[3];
  if (!(g->move > 0) || !is_surface(p, voxel)) return false;
  const double inset = normal_of(p, voxel, n);
  if (inset < 0) return false;
  for (int k = 0; k < 3; k++)
    axis[k] = (double)g->covariant[k][0] * n[0] + (double)g->covariant[k][1] * n[1] + (double)g->covariant[k][2] * n[2];
  normalise3(axis);
  *flat = 1 + ((double)TC_SPLAT_FLAT - 1) * (double)g->move;
  move[1] = (double)g->move * fmin(inset, 1);
  move[0] = move[1] - (double)(TC_SPLAT_FLAT * g->touch * g->move);
  return true;
}

/* A pixel's side in voxels at this depth (view space, mm). */
static double pixel_voxels(const pick *p, double deep) {
  return (p->frame.args.perspective ? deep : 1) / (double)p->frame.args.scale * length3(p->along);
}

/* Whether the voxel is drawn and the ray passes its core. *value: the voxel's; *t: distance of its drawn position, mm. */
static bool meets(const pick *p, const int voxel[3], double *t, double *value) {
  const tc_splat_args *g = &p->frame.args;
  double axis[3] = {0}, flat = 1, move[2] = {0}, to[3], way[3], deep = 0, deeper = 0;
  if (!filled_at(p, voxel, value)) return false;
  for (int i = 0; i < g->n_planes; i++)
    if (dot3(g->planes[i], (double[]){voxel[0], voxel[1], voxel[2]}) + g->planes[i][3] < 0) return false;
  shape_of(p, voxel, axis, &flat, move);
  for (int k = 0; k < 3; k++) {
    const double from_eye = voxel[k] - p->at[k];
    to[k] = from_eye + move[0] * axis[k], way[k] = p->along[k];
    deep += (double)g->axis[2][k] * (from_eye + move[1] * axis[k]), deeper += (double)g->axis[2][k] * way[k];
  }
  const double stretch[2] = {(1 / flat - 1) * dot3(to, axis), (1 / flat - 1) * dot3(way, axis)};
  for (int k = 0; k < 3; k++) to[k] += stretch[0] * axis[k], way[k] += stretch[1] * axis[k];
  const double along = dot3(to, way), away2 = dot3(to, to) - along * along / dot3(way, way);
  *t = deep / deeper;
  const double pixel = pixel_voxels(p, deep);
  return *t > 0 && along > 0 &&
         away2 <= (double)(g->touch * g->touch) + (double)(g->least2 * g->core * (1 - g->move)) * pixel * pixel;
}

/* Tests the voxels around the ray's position at t; updates the hit by nearer ones. */
static void look_around(const pick *p, double t, tc_splat_hit *hit) {
  const tc_splat_args *g = &p->frame.args;
  const double pixel = pixel_voxels(
      p, fmax(t * dot3(p->along, (double[]){(double)g->axis[2][0], (double)g->axis[2][1], (double)g->axis[2][2]}), 0));
  const int reach = (int)ceil((double)(g->touch + g->move) + fmin(0.72 * pixel, MOST_WIDER));
  int middle[3];
  for (int k = 0; k < 3; k++) middle[k] = (int)lround(p->at[k] + t * p->along[k]);
  for (int z = middle[2] - reach; z <= middle[2] + reach; z++)
    for (int y = middle[1] - reach; y <= middle[1] + reach; y++)
      for (int x = middle[0] - reach; x <= middle[0] + reach; x++) {
        double at, value;
        if (!meets(p, (int[]){x, y, z}, &at, &value) || at >= hit->distance_mm) continue;
        *hit = (tc_splat_hit){.voxel = {x, y, z}, .value = value, .distance_mm = at};
      }
}

bool tc_splat_pick(const tc_volume *of, const tc_volume *labels, const tc_scene *scene, const double at[2],
                   tc_splat_hit *hit) {
  const tc_volume *volume = labels ? labels : of;
  const tc_splats none = {0};
  tc_frame frame = {.width = scene->image.width, .height = scene->image.height};
  const tc_splat_job job = {.volume = volume, .splats = &none, .scene = scene, .frame = &frame};
  pick p = {.volume = volume, .labels = labels != NULL, .scene = scene, .dims = tc_volume_describe(volume)->dims};
  *hit = (tc_splat_hit){.distance_mm = INFINITY};
  if (!tc_splat_frame_begin(&p.frame, &job, NULL)) return false;
  if (!labels && !tc_volume_sparse(volume))
    p.subject = tc_vmd_subject_new(volume, scene->splat.threshold[0], scene->splat.threshold[1]);
  set_ray(&p, at);
  const double voxels_a_mm = length3(p.along), step = 0.5 / voxels_a_mm;
  const double reach = (1 + (double)(p.frame.args.touch + p.frame.args.move)) / voxels_a_mm;
  /* A nearer hit may be found up to `reach` behind the first one. */
  for (double t = p.from; t <= p.to && t <= hit->distance_mm + reach; t += step) look_around(&p, t, hit);
  tc_vmd_subject_free(p.subject);
  tc_splat_frame_end(&p.frame);
  if (!isfinite(hit->distance_mm)) return false;
  tc_volume_index_to_lps(volume, (double[]){hit->voxel[0], hit->voxel[1], hit->voxel[2]}, hit->position);
  return true;
}
