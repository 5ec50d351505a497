#include <math.h>
#include <string.h>

#include "renderer/reference/integrator.h"

/* The grey of a slice through the window; places without a value are black. */
static void color_slice(const tc_reference *r, const double at[3], double color[3]) {
  double value, grey = tc_ref_value_at(&r->field, at, &value) && value == value ? tc_ref_window_grey(&r->window, value) : 0;
  for (int c = 0; c < 3; c++) color[c] = grey;
}

static bool meet_plane(const tc_ref_surface *s, const tc_ref_ray *ray, tc_ref_next_hit *next, bool *back) {
  double apart = s->plane[3], rate = 0;
  for (int k = 0; k < 3; k++) apart += s->plane[k] * ray->lps[k], rate += s->plane[k] * ray->lps_direction[k];
  next->t = -apart / rate, *back = rate > 0;
  return next->skip++ == 0 && next->t >= ray->enter && next->t <= ray->leave;
}

static bool meet(const tc_reference *r, const tc_ref_surface *s, const tc_ref_cast *ray, tc_ref_next_hit *next,
                 tc_ref_triangle_hit *on) {
  if (s->triangles) {
    const bool met = tc_ref_triangles_hit(s->triangles, &ray->open, next->skip++ ? next->t : -INFINITY, on);
    next->t = on->t;
    return met;
  }
  const bool of_label = s->kind == TC_SURFACE_OF_LABEL;
  tc_ref_ray own = ray->box;
  if (of_label ? !s->field.smooth || !tc_ref_ray_enter(&ray->open, s->field.desc, &own) : !ray->in_box) return false;
  if (s->kind == TC_SURFACE_OF_PLANE) return meet_plane(s, &own, next, &on->back);
  next->field = of_label ? &s->field : &r->field;
  const bool met = tc_ref_surface_hit(next->field, &own, of_label ? 0 : s->iso, next->skip++, &on->back, &next->t);
  for (int k = 0; k < 3; k++) next->at[k] = own.origin[k] + next->t * own.direction[k];
  return met;
}

bool tc_ref_hit_surface(const tc_reference *r, const tc_ref_surface *s, const tc_ref_cast *cast, tc_ref_next_hit *next) {
  const tc_ref_ray *ray = &cast->open;
  tc_reference_hit *hit = &next->hit;
  tc_ref_triangle_hit on;
  double at[3], gradient[3];
  next->bound = false;
  do {
    next->met = meet(r, s, cast, next, &on);
    if (!next->met) return false;
  } while (on.back && s->one_sided);
  tc_ref_shading shading = s->shading;
  for (int k = 0; k < 3; k++) {
    shading.view[k] = ray->lps_direction[k];
    at[k] = ray->origin[k] + next->t * ray->direction[k];
    hit->position[k] = ray->lps[k] + next->t * ray->lps_direction[k];
    hit->normal[k] = s->kind == TC_SURFACE_OF_PLANE ? s->plane[k] : on.normal[k];
  }
  hit->distance_mm = next->t - ray->eye;
  hit->surface = s->number, hit->label = s->label;
  memcpy(hit->color, s->colored ? on.color : s->color, sizeof hit->color);
  if (s->kind == TC_SURFACE_OF_PLANE) {
    color_slice(r, at, hit->color);
  } else if (s->triangles) {
    tc_ref_shade_normal(&shading, hit->normal, hit->color);
  } else {
    tc_ref_surface_gradient(next->field, shading.gradient, next->at, gradient);
    tc_ref_shade_surface(&shading, gradient, hit->normal, hit->color);
  }
  return true;
}

void tc_ref_begin_hits(const tc_reference *r, const tc_ref_cast *cast, tc_ref_next_hit *next) {
  for (size_t i = 0; i < r->n_surfaces; i++) {
    const tc_ref_surface *s = &r->surfaces[i];
    tc_ref_ray own;
    if (s->kind != TC_SURFACE_OF_LABEL) tc_ref_hit_surface(r, s, cast, &next[i]);
    else if (s->field.smooth && tc_ref_ray_enter(&cast->open, s->field.desc, &own))
      next[i].met = next[i].bound = tc_ref_walk_bound(&s->field, &own, &next[i].t);
  }
}

size_t tc_ref_find_nearest(const tc_reference *r, const tc_ref_cast *cast, tc_ref_next_hit *next) {
  for (;;) {
    size_t nearest = r->n_surfaces;
    for (size_t i = 0; i < r->n_surfaces; i++)
      if (next[i].met && (nearest == r->n_surfaces || next[i].t < next[nearest].t)) nearest = i;
    if (nearest == r->n_surfaces || !next[nearest].bound || tc_ref_stopped(r)) return nearest;
    tc_ref_hit_surface(r, &r->surfaces[nearest], cast, &next[nearest]);
  }
}

int tc_reference_layers(const tc_reference *r, double px, double py, double *distance_mm, int most) {
  tc_ref_next_hit *next = g_new0(tc_ref_next_hit, r->n_surfaces + 1);
  tc_ref_cast cast;
  double clear = 1;
  int n = 0;
  tc_ref_cast_pixel(r, px, py, &cast);
  tc_ref_begin_hits(r, &cast, next);
  while (n < most && clear * 4096 > 1 && !tc_ref_stopped(r)) {
    const size_t nearest = tc_ref_find_nearest(r, &cast, next);
    if (nearest == r->n_surfaces) break;
    distance_mm[n++] = next[nearest].hit.distance_mm;
    clear *= 1 - r->surfaces[nearest].opacity;
    tc_ref_hit_surface(r, &r->surfaces[nearest], &cast, &next[nearest]);
  }
  g_free(next);
  return n;
}

const tc_ref_surface *tc_ref_hit_nearest(const tc_reference *r, const tc_ref_cast *cast, tc_reference_hit *hit) {
  tc_ref_next_hit *next = g_new0(tc_ref_next_hit, r->n_surfaces + 1);
  tc_ref_begin_hits(r, cast, next);
  const size_t nearest = tc_ref_find_nearest(r, cast, next);
  *hit = next[nearest].hit;
  g_free(next);
  return nearest < r->n_surfaces ? &r->surfaces[nearest] : NULL;
}
