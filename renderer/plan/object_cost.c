#include "renderer/plan/object_cost.h"

#include <math.h>
#include <string.h>

#include "renderer/raycast/rays.h"
#include "renderer/raycast/isosurface.h"

#define SIDE 36        /* probing rays along the longer side of the picture */
#define NEAR 4         /* voxels: about the width of a block */
#define MOST_STEPS 4e5 /* of all rays together; in larger volumes the steps are longer */

#define MOST_APART 8 /* voxels between neighbouring rays, beyond which they share no cache lines at all */

/* Milliseconds per unit of each term, fitted on two threads of an AMD EPYC (Zen 4). */
static const double rates[TC_OBJECT_MODES][TC_TERM_COUNT] = {
    [TC_OBJECT_SPLAT] = {0.0439, 0, 0, 0, 0.00121, 0.00626, 0.00312, 0.0743, 0},
    [TC_OBJECT_ISOSURFACE] = {0.0406, 0, 0.00334, 0.000229, 0.00828, 0, 0, 0.00363, 0.0197},
    [TC_OBJECT_MESH] = {0.0109, 0.000279, 0, 0, 0.000357, 0.02, 0.013, 0, 0.00239},
};

tc_mode tc_object_mode_of(tc_object_mode mode) {
  static const tc_mode modes[TC_OBJECT_MODES] = {TC_MODE_SPLAT, TC_MODE_ISOSURFACE, TC_MODE_MESH};
  return modes[mode];
}

typedef struct walk {
  const tc_volume *volume;
  const tc_rays *rays;
  double least; /* threshold as a stored voxel */
  bool below;   /* negative slope: the object is at or below the threshold */
  double pixel_rays; /* pixels per probing ray, in thousands */
  double mm;         /* length of a step */
  double pixel_mm;   /* side of a pixel: at 1 mm from the eye, or for parallel rays anywhere */
  double voxel_mm2;  /* mean area of a voxel's faces */
  double *terms;
} walk;

typedef struct line {
  double at[3], along[3]; /* index position at t = 0, and its change per mm */
  double eye_t;           /* t of the eye */
  double from, to;
} line;

static void clip(line *l, double at, double along) { /* at + t * along >= 0 */
  const double t = -at / along;
  if (along > 0)
    l->from = fmax(l->from, t);
  else if (along < 0)
    l->to = fmin(l->to, t);
  else if (at < 0)
    l->to = -INFINITY;
}

static line line_through(const tc_rays *rays, double x, double y) {
  line l = {.from = -INFINITY, .to = rays->far_mm};
  double view[3], length = 0;
  for (int k = 0; k < 3; k++) {
    view[k] = rays->view0[k] + x * rays->view_du[k] + y * rays->view_dv[k];
    length += view[k] * view[k];
  }
  length = sqrt(length);
  l.from = l.eye_t = rays->perspective ? -length : -rays->eye_mm;
  for (int r = 0; r < 3; r++) {
    l.at[r] = rays->anchor0[r] + x * rays->anchor_du[r] + y * rays->anchor_dv[r];
    for (int k = 0; k < 3; k++) l.along[r] += rays->to_index[3 * r + k] * view[k] / length;
    clip(&l, l.at[r] - rays->lo[r], l.along[r]);
    clip(&l, rays->hi[r] - l.at[r], -l.along[r]);
  }
  for (int i = 0; i < rays->n_planes; i++) {
    const double *p = rays->planes[i];
    clip(&l, p[0] * l.at[0] + p[1] * l.at[1] + p[2] * l.at[2] + p[3],
         p[0] * l.along[0] + p[1] * l.along[1] + p[2] * l.along[2]);
  }
  return l;
}

static bool is_inside(const walk *w, const int at[3]) {
  double voxel;
  return tc_volume_voxel(w->volume, at, &voxel) && (w->below ? voxel <= w->least : voxel >= w->least);
}

static void place(const line *l, double t, int at[3]) {
  for (int k = 0; k < 3; k++) at[k] = (int)(l->at[k] + t * l->along[k] + 0.5);
}

/* True if the surface is near: one of the voxels NEAR away along the axes, or NEAR / 2 along the diagonals, is on its
 * other side. */
static bool is_near(const walk *w, const int at[3], bool inside) {
  for (int i = 0; i < 14; i++) {
    int beside[3] = {at[0], at[1], at[2]};
    if (i < 6) beside[i / 2] += i & 1 ? NEAR : -NEAR;
    for (int k = 0; k < 3 && i >= 6; k++) beside[k] += (i - 6) >> k & 1 ? NEAR / 2 : -NEAR / 2;
    if (is_inside(w, beside) != inside) return true;
  }
  return false;
}

/* Marches one ray through the volume; counts steps up to its first hit, and all crossings of the surface. */
static void walk_line(const walk *w, const line *l) {
  double *terms = w->terms;
  bool was = false, hit = false;
  terms[TC_TERM_RAYS] += w->pixel_rays;
  int steps = 0;
  for (double t = l->from; t < l->to; t += w->mm, steps++) {
    int at[3];
    place(l, t, at);
    const bool inside = is_inside(w, at);
    if (!hit) terms[TC_TERM_STEPS] += w->pixel_rays * w->mm;
    if (!hit && steps % NEAR == 0 && is_near(w, at, inside)) terms[TC_TERM_NEAR] += NEAR * w->pixel_rays * w->mm;
    if (inside != was) {
      const double side = w->pixel_mm * (w->rays->perspective ? t - l->eye_t : 1);
      const double voxels = w->pixel_rays * side * side / w->voxel_mm2;
      terms[TC_TERM_SURFACE] += voxels;
      if (!hit) terms[TC_TERM_SEEN] += voxels, terms[TC_TERM_HITS] += w->pixel_rays;
      hit = true;
    }
    was = inside;
  }
}

bool tc_is_object(const tc_volume *volume, const tc_scene *s) {
  if (tc_volume_sparse(volume) || s->labels.volume[0]) return false;
  if (s->mode == TC_MODE_MESH && (s->mesh.n_surfaces || s->mesh.with_volume)) return false;
  return tc_is_surface(s->mode) || (s->mode == TC_MODE_SPLAT && s->splat.opaque);
}

/* False: cancelled. */
static bool walk_all(walk *w, int width, int height, const atomic_bool *cancel) {
  const double cell = fmax(1, fmax(width, height) / (double)SIDE);
  const int across = (int)ceil(width / cell), down = (int)ceil(height / cell);
  w->pixel_rays = (double)width * height / (across * down) / 1000;
  double length = 0;
  for (int pass = 0; pass < 2; pass++) {
    for (int i = 0; i < across * down; i++) {
      if (cancel && atomic_load(cancel)) return false;
      const line l = line_through(w->rays, (i % across + 0.5) * width / across, (i / across + 0.5) * height / down);
      if (!(l.from < l.to)) continue;
      if (pass)
        walk_line(w, &l);
      else
        length += l.to - l.from;
    }
    w->mm = fmax(w->mm, length / MOST_STEPS);
  }
  return true;
}

void tc_object_cost_scale(tc_object_cost *cost, const double speed[TC_OBJECT_MODES]) {
  cost->cheapest = 0;
  for (int m = 0; m < TC_OBJECT_MODES; m++) {
    cost->ms[m] *= speed[m];
    if (cost->ms[m] < cost->ms[cost->cheapest]) cost->cheapest = (tc_object_mode)m;
  }
}

bool tc_object_cost_of(const tc_volume *volume, const tc_scene *scene, int width, int height, const atomic_bool *cancel,
                       tc_object_cost *cost) {
  memset(cost, 0, sizeof *cost);
  if (!tc_is_object(volume, scene)) return false;
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_camera *c = &scene->camera;
  tc_rays rays;
  tc_rays_set_up(&rays, volume, scene, width, height);
  const double value = scene->mode == TC_MODE_SPLAT ? scene->splat.threshold[0] : scene->isosurface.value;
  const double mean = cbrt(d->spacing[0] * d->spacing[1] * d->spacing[2]);
  walk w = {.volume = volume,
            .rays = &rays,
            .least = (value - d->intercept) / d->slope,
            .below = d->slope < 0,
            .mm = fmin(d->spacing[0], fmin(d->spacing[1], d->spacing[2])),
            .pixel_mm = (rays.perspective ? 2 * tan(c->fov_y_deg * (M_PI / 360)) : c->height_mm) / height,
            .voxel_mm2 = mean * mean,
            .terms = cost->terms};
  cost->terms[TC_TERM_FRAME] = 1;
  cost->terms[TC_TERM_PIXELS] = (double)width * height / 1000;
  if (!walk_all(&w, width, height, cancel)) return false;
  double *t = cost->terms;
  if (!(t[TC_TERM_HITS] > 0)) return false;
  t[TC_TERM_STEPS] /= mean, t[TC_TERM_NEAR] /= mean;
  t[TC_TERM_APART] = t[TC_TERM_NEAR] * fmin(sqrt(t[TC_TERM_SEEN] / t[TC_TERM_HITS]), MOST_APART);
  for (int m = 0; m < TC_OBJECT_MODES; m++) {
    for (int i = 0; i < TC_TERM_COUNT; i++) cost->ms[m] += rates[m][i] * cost->terms[i];
    if (cost->ms[m] < cost->ms[cost->cheapest]) cost->cheapest = (tc_object_mode)m;
  }
  return true;
}
