#include "renderer/reference/reference.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "renderer/reference/integrator.h"


/* The span of a piece is the one above its lower end, for either direction of the ray. */
static void span_of(const tc_reference *r, const tc_ref_piece *piece, tc_ref_span *span) {
  tc_ref_span_above(&r->transfer, fmin(piece->front, piece->back), span);
}

/* The scene's shading for one ray; NULL: none. */
static const tc_ref_shading *shading_of(const tc_reference *r, const tc_ref_ray *ray, tc_ref_shading *shading) {
  if (r->shading.model == TC_SHADING_NONE) return NULL;
  *shading = r->shading;
  memcpy(shading->view, ray->lps_direction, sizeof shading->view);
  return shading;
}

static bool next_cell(const tc_reference *r, tc_ref_walk *walk, tc_ref_label_walk *labels, tc_ref_cell *cell) {
  if (tc_ref_stopped(r)) return false;
  return r->labels.desc ? tc_ref_labels_next(&r->labels, walk, labels, cell) : tc_ref_walk_next(walk, cell);
}

static void integrate_cell(const tc_reference *r, const tc_ref_cell *cell, const tc_ref_shading *shading,
                           tc_ref_light *light) {
  tc_ref_cutter cutter;
  tc_ref_piece piece;
  tc_ref_span span;
  tc_ref_cutter_start(&cutter, cell, r->transfer.breaks, r->transfer.n_breaks);
  while (!tc_ref_stopped(r) && tc_ref_cutter_next(&cutter, &piece)) {
    span_of(r, &piece, &span);
    tc_ref_integrate(&piece, &span, shading, r->tolerance, light);
  }
}

/* The grey of the field along the ray; false: the ray meets no visible part of the field. */
static bool project(const tc_reference *r, const tc_ref_ray *ray, double *grey) {
  tc_ref_extent extent = {.lo = INFINITY, .hi = -INFINITY};
  tc_ref_walk walk;
  tc_ref_cell cell;
  tc_ref_walk_start(&walk, &r->field, ray);
  tc_ref_label_walk labels = {.u = 1};
  while (next_cell(r, &walk, &labels, &cell)) tc_ref_extent_add(&extent, &cell);
  if (!(extent.length > 0)) return false;
  double value = r->mode == TC_MODE_MIP     ? extent.hi
                 : r->mode == TC_MODE_MINIP ? extent.lo
                                            : extent.integral / extent.length;
  *grey = tc_ref_window_grey(&r->window, value);
  return true;
}

static void integrate(const tc_reference *r, const tc_ref_ray *ray, tc_ref_light *light) {
  tc_ref_walk walk;
  tc_ref_cell cell;
  tc_ref_shading own;
  const tc_ref_shading *shading = shading_of(r, ray, &own);
  tc_ref_label_walk labels = {.u = 1};
  tc_ref_walk_start(&walk, &r->field, ray);
  while (next_cell(r, &walk, &labels, &cell))
    if (!tc_ref_transfer_empty(&r->transfer, cell.lo, cell.hi)) integrate_cell(r, &cell, shading, light);
}

bool tc_reference_surface(const tc_reference *r, double px, double py, tc_reference_hit *hit) {
  tc_ref_cast ray;
  if (!tc_ref_is_surface(r->mode)) return false;
  tc_ref_cast_pixel(r, px, py, &ray);
  return tc_ref_hit_nearest(r, &ray, hit);
}

/* The ray's light so far; light.color and light.transparency include surfaces and, in dvr, the volume. */
typedef struct blend {
  tc_ref_light light;
  double most; /* grey of the volume in mip; -1: none */
} blend;

/* In mip a part with grey m covers the share m of everything behind it, as far as m exceeds the parts before. */
static void add_part(const tc_reference *r, const tc_ref_ray *part, blend *b) {
  double grey;
  if (!(part->enter < part->leave)) return;
  if (r->mode == TC_MODE_DVR) integrate(r, part, &b->light);
  if (r->mode != TC_MODE_MIP || !project(r, part, &grey)) return;
  const double rise = b->light.transparency * fmax(grey - fmax(b->most, 0), 0);
  for (int c = 0; c < 3; c++) b->light.color[c] += rise;
  b->light.opacity += rise;
  b->most = fmax(b->most, grey);
}

static void add_hit(const tc_ref_surface *s, const tc_reference_hit *hit, blend *b) {
  const double share = b->light.transparency * (1 - fmax(b->most, 0)) * s->opacity;
  for (int c = 0; c < 3; c++) b->light.color[c] += share * hit->color[c];
  b->light.opacity += share;
  b->light.transparency *= 1 - s->opacity;
}

/* All hits of all surfaces from front to back, and the volume between them. */
static void composite_surfaces(const tc_reference *r, const tc_ref_cast *ray, blend *b) {
  tc_ref_next_hit *next = g_new0(tc_ref_next_hit, r->n_surfaces + 1);
  tc_ref_ray part = ray->box;
  tc_ref_begin_hits(r, ray, next);
  while (b->light.transparency > 0 && !tc_ref_stopped(r)) {
    const size_t nearest = tc_ref_find_nearest(r, ray, next);
    const bool last = nearest == r->n_surfaces;
    part.leave = last ? ray->box.leave : fmin(ray->box.leave, next[nearest].t);
    if (r->within && ray->in_box) add_part(r, &part, b);
    if (last) break;
    add_hit(&r->surfaces[nearest], &next[nearest].hit, b);
    part.enter = fmax(part.enter, next[nearest].t);
    tc_ref_hit_surface(r, &r->surfaces[nearest], ray, &next[nearest]);
  }
  g_free(next);
}

void tc_reference_pixel(const tc_reference *r, double px, double py, double rgba[4]) {
  blend b = {.light.transparency = 1, .most = -1};
  tc_ref_cast ray;
  double grey;
  tc_ref_cast_pixel(r, px, py, &ray);
  memset(rgba, 0, 4 * sizeof *rgba);
  if (r->n_surfaces) {
    composite_surfaces(r, &ray, &b);
  } else if (ray.in_box && tc_ref_is_projection(r->mode)) {
    if (!project(r, &ray.box, &grey)) return;
    rgba[0] = rgba[1] = rgba[2] = grey, rgba[3] = 1;
    return;
  } else if (ray.in_box && r->mode == TC_MODE_DVR) {
    integrate(r, &ray.box, &b.light);
  }
  const bool sums = b.light.opacity < 0.5 || r->mode == TC_MODE_MIP;
  for (int c = 0; c < 3; c++) rgba[c] = b.light.color[c];
  rgba[3] = b.most >= 0 ? 1 : sums ? b.light.opacity : 1 - b.light.transparency;
}

static tc_reference_sample describe_piece(const tc_reference *r, const tc_ref_ray *ray, const tc_ref_cell *cell,
                                          const tc_ref_piece *piece, const tc_ref_shading *shading,
                                          double transparency) {
  double t = cell->from + piece->from * cell->length;
  tc_reference_sample s = {.distance_mm = t - ray->eye,
                           .length_mm = piece->width * cell->length,
                           .value = piece->front,
                           .value_back = piece->back,
                           .transparency = transparency};
  if (tc_ref_is_projection(r->mode)) {
    s.color[0] = s.color[1] = s.color[2] = tc_ref_window_grey(&r->window, piece->front);
  } else {
    tc_ref_span span;
    span_of(r, piece, &span);
    double f = fmin(fmax((piece->front - span.base) * span.inverse_width, 0), 1);
    s.extinction = tc_ref_span_extinction(&span, f);
    tc_ref_span_color(&span, f, s.color);
    if (cell->label) {
      double tint[4];
      s.extinction *= tc_ref_label_mean(cell->label, piece->from, tint);
      tc_ref_label_tint(cell->label, piece->from, s.color);
    }
    if (shading) tc_ref_shade(shading, cell, piece->from, s.color);
  }
  for (int k = 0; k < 3; k++) s.position[k] = ray->lps[k] + t * ray->lps_direction[k];
  return s;
}

/* Lists the pieces in front of the hit, and the hit. */
static void list_surface(const tc_reference *r, const tc_ref_cast *cast, GArray *list) {
  tc_reference_hit hit;
  const tc_ref_ray *ray = &cast->box;
  const tc_ref_surface *met = tc_ref_hit_nearest(r, cast, &hit);
  if (!r->n_surfaces) return;
  tc_ref_walk walk;
  tc_ref_cell cell;
  tc_ref_walk_start(&walk, &r->field, ray);
  while (!tc_ref_stopped(r) && tc_ref_walk_next(&walk, &cell)) {
    tc_ref_cutter cutter;
    tc_ref_piece piece;
    tc_ref_cutter_start(&cutter, &cell, met ? &met->iso : &r->surfaces->iso, 1);
    while (tc_ref_cutter_next(&cutter, &piece)) {
      tc_reference_sample s = {.distance_mm = cell.from + piece.from * cell.length - ray->eye,
                               .length_mm = piece.width * cell.length,
                               .value = piece.front,
                               .value_back = piece.back,
                               .transparency = 1};
      for (int k = 0; k < 3; k++) s.position[k] = ray->lps[k] + (s.distance_mm + ray->eye) * ray->lps_direction[k];
      if (met && s.distance_mm >= hit.distance_mm) {
        s.length_mm = 0;
        s.value_back = s.value;
        s.distance_mm = hit.distance_mm;
        memcpy(s.position, hit.position, sizeof s.position);
        memcpy(s.color, hit.color, sizeof s.color);
      }
      g_array_append_val(list, s);
      if (met && s.distance_mm >= hit.distance_mm) return;
    }
  }
}

void tc_reference_ray(const tc_reference *r, double px, double py, tc_reference_sample **samples, size_t *count) {
  GArray *list = g_array_new(FALSE, FALSE, sizeof(tc_reference_sample));
  tc_ref_light light = {.transparency = 1};
  tc_ref_cast of;
  tc_ref_cast_pixel(r, px, py, &of);
  const tc_ref_ray ray = of.box;
  if (of.in_box && tc_ref_is_surface(r->mode)) {
    list_surface(r, &of, list);
  } else if (of.in_box) {
    tc_ref_walk walk;
    tc_ref_cell cell;
    tc_ref_shading own;
    const tc_ref_shading *shading = shading_of(r, &ray, &own);
    tc_ref_label_walk labels = {.u = 1};
    tc_ref_walk_start(&walk, &r->field, &ray);
    while (next_cell(r, &walk, &labels, &cell)) {
      tc_ref_cutter cutter;
      tc_ref_piece piece;
      tc_ref_span span;
      tc_ref_cutter_start(&cutter, &cell, r->transfer.breaks, r->transfer.n_breaks);
      while (!tc_ref_stopped(r) && tc_ref_cutter_next(&cutter, &piece)) {
        tc_reference_sample s = describe_piece(r, &ray, &cell, &piece, shading, light.transparency);
        g_array_append_val(list, s);
        if (tc_ref_is_projection(r->mode)) continue;
        span_of(r, &piece, &span);
        tc_ref_integrate(&piece, &span, shading, r->tolerance, &light);
      }
    }
  }
  *count = list->len;
  *samples = (tc_reference_sample *)(void *)g_array_free(list, list->len == 0);
}

typedef struct image_job {
  const tc_reference *reference;
  float *rgba;
} image_job;

static void render_row(void *data, int row) {
  const image_job *job = data;
  const int width = job->reference->camera.width;
  for (int column = 0; column < width; column++) {
    double rgba[4];
    float *to = job->rgba + ((size_t)row * (size_t)width + (size_t)column) * 4;
    tc_reference_pixel(job->reference, column + 0.5, row + 0.5, rgba);
    for (int c = 0; c < 4; c++) to[c] = (float)rgba[c];
  }
}

bool tc_reference_image(const tc_reference *reference, int threads, float *rgba, GError **error) {
  image_job job = {.reference = reference, .rgba = rgba};
  if (threads < 0 || threads > TC_REF_THREADS) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "reference: %d threads: 0 to %d expected", threads, TC_REF_THREADS);
    return false;
  }
  tc_ref_parallel(&(tc_ref_loop){reference->camera.height, NULL, render_row, &job}, threads);
  return true;
}
