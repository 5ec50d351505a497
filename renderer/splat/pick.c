#include "renderer/splat/pick.h"

#include <math.h>

#include "renderer/raycast/rays.h"
#include "renderer/splat/splatter.h"

/* A ray in index coordinates: at + t * along, t in mm from the eye. */
typedef struct pick {
  const tc_volume *volume;
  const tc_scene *scene;
  const int *dims;
  bool labels; /* the volume's values are */
  double at[3], along[3];
  double from, to; /* mm within the volume's box, widened by a voxel */
  double planes[TC_MAX_CLIP_PLANES][4];
  int n_planes;
  double reach2; /* of a core, voxels, squared */
} pick;

static void set_ray(pick *p, int width, int height, double x, double y) {
  tc_rays rays;
  double view[3], length = 0;
  tc_rays_set_up(&rays, p->volume, p->scene, width, height);
  for (int k = 0; k < 3; k++) {
    view[k] = rays.view0[k] + x * rays.view_du[k] + y * rays.view_dv[k];
    length += view[k] * view[k];
  }
  length = sqrt(length);
  const double eye = rays.perspective ? length : rays.eye_mm;
  for (int r = 0; r < 3; r++) {
    p->along[r] = 0;
    for (int k = 0; k < 3; k++) p->along[r] += rays.to_index[3 * r + k] * view[k] / length;
    p->at[r] = rays.anchor0[r] + x * rays.anchor_du[r] + y * rays.anchor_dv[r] - eye * p->along[r];
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

/* The voxel's own value, if it is drawn and the ray passes its core; *t: where along the ray its centre is. */
static bool meets(const pick *p, const int voxel[3], double *t, double *value) {
  const double index[3] = {voxel[0], voxel[1], voxel[2]};
  double along2 = 0, dot = 0, away2 = 0;
  for (int k = 0; k < 3; k++) {
    if (voxel[k] < 0 || voxel[k] >= p->dims[k]) return false;
    along2 += p->along[k] * p->along[k];
    dot += p->along[k] * (index[k] - p->at[k]);
  }
  *t = dot / along2;
  for (int k = 0; k < 3; k++) {
    const double d = index[k] - p->at[k] - *t * p->along[k];
    away2 += d * d;
  }
  if (*t <= 0 || away2 > p->reach2 || !tc_volume_value_at(p->volume, index, value)) return false;
  for (int i = 0; i < p->n_planes; i++) {
    const double *n = p->planes[i];
    if (n[0] * index[0] + n[1] * index[1] + n[2] * index[2] + n[3] < 0) return false;
  }
  return is_filled(p, *value);
}

/* Looks around the place at t; keeps what is nearer than the hit so far. */
static void look_around(const pick *p, double t, tc_splat_hit *hit) {
  const int reach = (int)ceil(sqrt(p->reach2));
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

bool tc_splat_pick(const tc_volume *of, const tc_volume *labels, const tc_scene *scene, int width, int height, double x,
                   double y, tc_splat_hit *hit) {
  const double core = fmax(TC_SPLAT_CORE * scene->splat.kernel_radius, fmin(scene->splat.kernel_radius, TC_SPLAT_CORE));
  const tc_volume *volume = labels ? labels : of;
  pick p = {.volume = volume,
            .labels = labels != NULL,
            .scene = scene,
            .dims = tc_volume_describe(volume)->dims,
            .reach2 = core * core};
  p.n_planes = tc_splat_planes(volume, scene, p.planes);
  set_ray(&p, width, height, x, y);
  const double voxels_a_mm = sqrt(p.along[0] * p.along[0] + p.along[1] * p.along[1] + p.along[2] * p.along[2]);
  const double step = 0.5 / voxels_a_mm, reach = (1 + core) / voxels_a_mm;
  *hit = (tc_splat_hit){.distance_mm = INFINITY};
  /* What is found at a place may have something nearer beside it, a little further on. */
  for (double t = p.from; t <= p.to && t <= hit->distance_mm + reach; t += step) look_around(&p, t, hit);
  if (!isfinite(hit->distance_mm)) return false;
  tc_volume_index_to_lps(volume, (double[]){hit->voxel[0], hit->voxel[1], hit->voxel[2]}, hit->position);
  return true;
}
