#include "renderer/reference/reference.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "renderer/reference/internal.h"

#define MOST_THREADS 256

/* Of modes isosurface and mesh. */
typedef struct ref_surface {
  double iso, color[3], opacity; /* compositing space */
  bool one_sided;
  tc_ref_shading shading;
} ref_surface;

struct tc_reference {
  tc_volume *volume;
  tc_ref_camera camera;
  tc_ref_clip clip;
  tc_ref_field field;
  tc_ref_transfer transfer; /* dvr */
  tc_ref_shading shading;   /* dvr */
  tc_mode mode;
  tc_ref_window window;    /* projections */
  tc_volume *label_volume; /* or NULL */
  tc_scene scene;          /* copy of the labels' members; zero without labels */
  tc_ref_labels labels;
  ref_surface *surfaces; /* [n_surfaces] */
  size_t n_surfaces;
  double tolerance;
  const atomic_bool *cancel; /* or NULL */
};

static bool is_projection(tc_mode mode) {
  return mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE;
}

static bool stopped(const tc_reference *r) {
  return r->cancel && atomic_load_explicit(r->cancel, memory_order_relaxed);
}

/* Of a mesh too the truth is the surface that the field has. */
static bool is_surface(tc_mode mode) { return mode == TC_MODE_ISOSURFACE || mode == TC_MODE_MESH; }

static bool shows(const tc_mesh_surface *s) { return s->visible && s->opacity > 0; }

const char *tc_reference_missing(const tc_scene *scene) {
  bool surface = is_surface(scene->mode);
  if (scene->mode != TC_MODE_DVR && !surface && !is_projection(scene->mode)) return "/mode";
  if (scene->mode == TC_MODE_MESH && scene->labels.volume[0] && !scene->mesh.n_surfaces) return "/mode"; /* of labels */
  if (scene->mode == TC_MODE_MESH && scene->mesh.n_lights) return "/mesh/lights";
  for (size_t i = 0; i < scene->mesh.n_surfaces && scene->mode == TC_MODE_MESH; i++)
    if (shows(&scene->mesh.surfaces[i]) && scene->mesh.surfaces[i].source != TC_SURFACE_OF_VALUE) return "/mesh/surfaces";
  if (scene->mesh.n_surfaces && scene->mesh.with_volume && (scene->mode == TC_MODE_DVR || scene->mode == TC_MODE_MIP))
    return "/mesh/withVolume";
  if ((unsigned)scene->filter >= TC_FILTER_COUNT || (surface && scene->filter != TC_FILTER_LINEAR)) return "/filter";
  if (scene->labels.volume[0] && scene->mode == TC_MODE_DVR) return "/labels/volume";
  return NULL;
}

static bool add_surface(tc_reference *r, const tc_scene *scene, const tc_mesh_surface *item, GError **error) {
  const double *srgb = item->has_color ? item->color : scene->isosurface.color;
  ref_surface *s = &r->surfaces[r->n_surfaces++];
  tc_scene own = *scene; /* borrows */
  *s = (ref_surface){.iso = item->value, .opacity = item->opacity, .one_sided = !item->two_sided};
  for (int c = 0; c < 3; c++) s->color[c] = scene->image.linear_light ? tc_ref_to_linear(srgb[c]) : srgb[c];
  if (item->own_shading & 1) own.shading.model = item->model;
  if (item->own_shading & 2) own.shading.ambient = item->ambient;
  if (item->own_shading & 4) own.shading.diffuse = item->diffuse;
  if (item->own_shading & 8) own.shading.specular = item->specular;
  if (item->own_shading & 16) own.shading.shininess = item->shininess;
  tc_ref_shading_set_up(&s->shading, r->volume, &own);
  if (isfinite(s->iso)) return true;
  tc_set_error(error, TC_ERROR_INVALID, "/isosurface/value", "reference: isosurface: a finite value wanted");
  return false;
}

static bool set_up_surfaces(tc_reference *r, const tc_scene *scene, GError **error) {
  const tc_mesh_surface one = {.value = scene->isosurface.value, .opacity = 1, .visible = true, .two_sided = true};
  const bool listed = scene->mode == TC_MODE_MESH && scene->mesh.n_surfaces;
  const tc_mesh_surface *of = listed ? scene->mesh.surfaces : &one;
  const size_t n = listed ? scene->mesh.n_surfaces : 1;
  r->surfaces = g_new0(ref_surface, n);
  for (size_t i = 0; i < n; i++)
    if (shows(&of[i]) && !add_surface(r, scene, &of[i], error)) return false;
  return true;
}

/* Sets up what the mode reads: transfer function, window or isosurface value. */
static bool set_up_appearance(tc_reference *r, const tc_scene *scene, GError **error) {
  r->mode = scene->mode;
  if (is_surface(scene->mode)) return set_up_surfaces(r, scene, error);
  if (!is_projection(scene->mode)) {
    if (tc_ref_transfer_set_up(&r->transfer, &scene->transfer_function, scene->image.linear_light)) return true;
    tc_set_error(error, TC_ERROR_INVALID, "/transferFunction",
                 "reference: transfer function: at least one knot wanted, all "
                 "finite, values ascending");
    return false;
  }
  r->window = (tc_ref_window){scene->window.center, scene->window.width, scene->image.linear_light};
  if (isfinite(r->window.center) && isfinite(r->window.width) && r->window.width > 0) return true;
  tc_set_error(error, TC_ERROR_INVALID, "/window", "reference: window: a finite center and a width above 0 wanted");
  return false;
}

tc_reference *tc_reference_new(tc_volume *volume, const tc_scene *scene, int width, int height, double tolerance,
                               GError **error) {
  return tc_reference_new_labelled(volume, NULL, scene, width, height, tolerance, error);
}

tc_reference *tc_reference_new_labelled(tc_volume *volume, tc_volume *labels, const tc_scene *scene, int width,
                                        int height, double tolerance, GError **error) {
  return tc_reference_new_stoppable(volume, labels, scene, width, height, tolerance, NULL, error);
}

tc_reference *tc_reference_new_stoppable(tc_volume *volume, tc_volume *labels, const tc_scene *scene, int width,
                                         int height, double tolerance, const atomic_bool *cancel, GError **error) {
  const char *member = tc_reference_missing(scene);
  if (member && !(labels && !strcmp(member, "/labels/volume"))) {
    tc_set_error(
        error, TC_ERROR_UNSUPPORTED, member,
        "reference: %s: only dvr, mip, minip and average of any field and isosurfaces of the linear one, plain, are "
        "integrated",
        member);
    return NULL;
  }
  if (width < 1 || height < 1 || !(tolerance == 0 || (tolerance >= 1e-14 && tolerance <= 0.1))) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "reference: %dx%d pixels to %g: at least 1x1 and 1e-14 .. 0.1 wanted",
                 width, height, tolerance);
    return NULL;
  }
  tc_reference *r = g_new0(tc_reference, 1);
  r->cancel = cancel;
  r->volume = tc_volume_ref(volume);
  r->field =
      (tc_ref_field){.filter = scene->filter, .desc = tc_volume_describe(volume), .voxels = tc_volume_data(volume)};
  if (tc_volume_gaps(volume) && is_surface(scene->mode)) r->field.gaps = tc_volume_data(tc_volume_gaps(volume));
  if (labels && scene->labels.volume[0] && scene->mode == TC_MODE_DVR) {
    r->label_volume = tc_volume_ref(labels);
    tc_scene_copy(&r->scene, scene);
    tc_ref_labels_set_up(&r->labels, labels, &r->scene);
  } else if (tc_volume_gaps(volume) && !is_surface(scene->mode)) {
    r->label_volume = tc_volume_ref(tc_volume_gaps(volume));
    r->scene.filter = scene->filter;
    tc_ref_labels_of_gaps(&r->labels, r->label_volume, &r->scene);
  }
  if (scene->filter == TC_FILTER_CUBIC && scene->sampling.prefilter) {
    r->field.coefficients = tc_ref_coefficients(&r->field, cancel);
    if (stopped(r)) {
      tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
      goto fail;
    }
    if (!r->field.coefficients) {
      tc_set_error(error, TC_ERROR_MEMORY, "/sampling/prefilter", "reference: no memory for the coefficients");
      goto fail;
    }
  }
  tc_ref_clip_set_up(&r->clip, scene);
  /* The errors of pieces add up, but each piece's estimate is pessimistic by orders of magnitude. */
  r->tolerance = (tolerance == 0 ? 1e-10 : tolerance) / 16;
  if (scene->mode == TC_MODE_DVR && scene->shading.model != TC_SHADING_NONE)
    tc_ref_shading_set_up(&r->shading, volume, scene);
  member = tc_ref_camera_set_up(&r->camera, &scene->camera, width, height);
  if (member) {
    tc_set_error(error, TC_ERROR_INVALID, member,
                 "reference: camera: position, target and up must span a plane and the "
                 "view be wider than 0 and narrower than 180 degrees");
    goto fail;
  }
  if (set_up_appearance(r, scene, error)) return r;
fail:
  tc_reference_free(r);
  return NULL;
}

void tc_reference_free(tc_reference *reference) {
  if (!reference) return;
  tc_ref_transfer_clear(&reference->transfer);
  tc_volume_unref(reference->volume);
  tc_volume_unref(reference->label_volume);
  tc_scene_clear(&reference->scene);
  g_free(reference->field.coefficients);
  g_free(reference->surfaces);
  g_free(reference);
}

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
  if (stopped(r)) return false;
  return r->labels.desc ? tc_ref_labels_next(&r->labels, walk, labels, cell) : tc_ref_walk_next(walk, cell);
}

static void integrate_cell(const tc_reference *r, const tc_ref_cell *cell, const tc_ref_shading *shading,
                           tc_ref_light *light) {
  tc_ref_cutter cutter;
  tc_ref_piece piece;
  tc_ref_span span;
  tc_ref_cutter_start(&cutter, cell, r->transfer.breaks, r->transfer.n_breaks);
  while (!stopped(r) && tc_ref_cutter_next(&cutter, &piece)) {
    span_of(r, &piece, &span);
    tc_ref_integrate(&piece, &span, shading, r->tolerance, light);
  }
}

static void project(const tc_reference *r, const tc_ref_ray *ray, double rgba[4]) {
  tc_ref_extent extent = {.lo = INFINITY, .hi = -INFINITY};
  tc_ref_walk walk;
  tc_ref_cell cell;
  tc_ref_walk_start(&walk, &r->field, ray);
  tc_ref_label_walk labels = {.u = 1};
  while (next_cell(r, &walk, &labels, &cell)) tc_ref_extent_add(&extent, &cell);
  memset(rgba, 0, 4 * sizeof *rgba);
  if (!(extent.length > 0)) return;
  double value = r->mode == TC_MODE_MIP     ? extent.hi
                 : r->mode == TC_MODE_MINIP ? extent.lo
                                            : extent.integral / extent.length;
  rgba[0] = rgba[1] = rgba[2] = tc_ref_window_grey(&r->window, value);
  rgba[3] = 1;
}

/* Where the ray meets the surface for the *skip-th time; then the next one's number. */
static bool hit_surface(const tc_reference *r, const ref_surface *s, const tc_ref_ray *ray, int *skip, tc_reference_hit *hit) {
  double t, at[3], gradient[3];
  bool leaves;
  do {
    if (!tc_ref_surface_hit(&r->field, ray, s->iso, (*skip)++, &leaves, &t)) return false;
  } while (leaves && s->one_sided);
  tc_ref_shading shading = s->shading;
  memcpy(shading.view, ray->lps_direction, sizeof shading.view);
  for (int k = 0; k < 3; k++) {
    at[k] = ray->origin[k] + t * ray->direction[k];
    hit->position[k] = ray->lps[k] + t * ray->lps_direction[k];
  }
  hit->distance_mm = t - ray->eye;
  memcpy(hit->color, s->color, sizeof hit->color);
  tc_ref_surface_gradient(&r->field, shading.gradient, at, gradient);
  tc_ref_shade_surface(&shading, gradient, hit->normal, hit->color);
  return true;
}

/* The nearest first hit of all surfaces, and whose it is; NULL: none. */
static const ref_surface *hit_nearest(const tc_reference *r, const tc_ref_ray *ray, tc_reference_hit *hit) {
  const ref_surface *nearest = NULL;
  for (size_t i = 0; i < r->n_surfaces; i++) {
    tc_reference_hit own;
    int skip = 0;
    if (!hit_surface(r, &r->surfaces[i], ray, &skip, &own) || (nearest && own.distance_mm >= hit->distance_mm)) continue;
    *hit = own, nearest = &r->surfaces[i];
  }
  return nearest;
}

bool tc_reference_surface(const tc_reference *r, double px, double py, tc_reference_hit *hit) {
  tc_ref_ray ray;
  return is_surface(r->mode) && tc_ref_ray_cast(&r->camera, &r->clip, r->field.desc, px, py, &ray) && hit_nearest(r, &ray, hit);
}

typedef struct next_hit {
  tc_reference_hit hit;
  int skip;
  bool met;
} next_hit;

/* Every hit of every surface, the nearest first. */
static void composite_surfaces(const tc_reference *r, const tc_ref_ray *ray, double rgba[4]) {
  next_hit *next = g_new0(next_hit, r->n_surfaces + 1);
  for (size_t i = 0; i < r->n_surfaces; i++) next[i].met = hit_surface(r, &r->surfaces[i], ray, &next[i].skip, &next[i].hit);
  while (rgba[3] < 1 && !stopped(r)) {
    size_t nearest = r->n_surfaces;
    for (size_t i = 0; i < r->n_surfaces; i++)
      if (next[i].met && (nearest == r->n_surfaces || next[i].hit.distance_mm < next[nearest].hit.distance_mm)) nearest = i;
    if (nearest == r->n_surfaces) break;
    const double share = (1 - rgba[3]) * r->surfaces[nearest].opacity;
    for (int c = 0; c < 3; c++) rgba[c] += share * next[nearest].hit.color[c];
    rgba[3] += share;
    next[nearest].met = hit_surface(r, &r->surfaces[nearest], ray, &next[nearest].skip, &next[nearest].hit);
  }
  g_free(next);
}

void tc_reference_pixel(const tc_reference *r, double px, double py, double rgba[4]) {
  tc_ref_light light = {.transparency = 1};
  tc_ref_ray ray;
  bool met = tc_ref_ray_cast(&r->camera, &r->clip, r->field.desc, px, py, &ray);
  if (is_surface(r->mode)) {
    memset(rgba, 0, 4 * sizeof *rgba);
    if (met) composite_surfaces(r, &ray, rgba);
    return;
  }
  if (met && is_projection(r->mode)) {
    project(r, &ray, rgba);
    return;
  }
  if (met) {
    tc_ref_walk walk;
    tc_ref_cell cell;
    tc_ref_shading own;
    const tc_ref_shading *shading = shading_of(r, &ray, &own);
    tc_ref_label_walk labels = {.u = 1};
    tc_ref_walk_start(&walk, &r->field, &ray);
    while (next_cell(r, &walk, &labels, &cell))
      if (!tc_ref_transfer_empty(&r->transfer, cell.lo, cell.hi)) integrate_cell(r, &cell, shading, &light);
  }
  for (int c = 0; c < 3; c++) rgba[c] = light.color[c];
  rgba[3] = light.opacity < 0.5 ? light.opacity : 1 - light.transparency;
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
  if (is_projection(r->mode)) {
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

/* Lists the transparent pieces up to the hit, and the hit. */
static void list_surface(const tc_reference *r, const tc_ref_ray *ray, GArray *list) {
  tc_reference_hit hit;
  const ref_surface *met = hit_nearest(r, ray, &hit);
  if (!r->n_surfaces) return;
  tc_ref_walk walk;
  tc_ref_cell cell;
  tc_ref_walk_start(&walk, &r->field, ray);
  while (!stopped(r) && tc_ref_walk_next(&walk, &cell)) {
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
  tc_ref_ray ray;
  bool met = tc_ref_ray_cast(&r->camera, &r->clip, r->field.desc, px, py, &ray);
  if (met && is_surface(r->mode)) {
    list_surface(r, &ray, list);
  } else if (met) {
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
      while (!stopped(r) && tc_ref_cutter_next(&cutter, &piece)) {
        tc_reference_sample s = describe_piece(r, &ray, &cell, &piece, shading, light.transparency);
        g_array_append_val(list, s);
        if (is_projection(r->mode)) continue;
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
  atomic_int row;
} image_job;

static void *render_rows(void *data) {
  image_job *job = data;
  int width = job->reference->camera.width, height = job->reference->camera.height;
  for (int row; (row = atomic_fetch_add(&job->row, 1)) < height;)
    for (int column = 0; column < width; column++) {
      double rgba[4];
      float *to = job->rgba + ((size_t)row * (size_t)width + (size_t)column) * 4;
      tc_reference_pixel(job->reference, column + 0.5, row + 0.5, rgba);
      for (int c = 0; c < 4; c++) to[c] = (float)rgba[c];
    }
  return NULL;
}

bool tc_reference_image(const tc_reference *reference, int threads, float *rgba, GError **error) {
  image_job job = {.reference = reference, .rgba = rgba};
  atomic_init(&job.row, 0);
  if (threads < 0 || threads > MOST_THREADS) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "reference: %d threads: 0 to %d wanted", threads, MOST_THREADS);
    return false;
  }
  if (threads == 0) threads = (int)CLAMP(sysconf(_SC_NPROCESSORS_ONLN), 1, MOST_THREADS);
  pthread_t helpers[MOST_THREADS];
  int started = 0;
  /* The calling thread works too, so a thread that cannot be created only costs time. */
  while (started < threads - 1 && pthread_create(&helpers[started], NULL, render_rows, &job) == 0) started++;
  render_rows(&job);
  for (int i = 0; i < started; i++) pthread_join(helpers[i], NULL);
  return true;
}
