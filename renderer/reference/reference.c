#include "renderer/reference/reference.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <string.h>
#include <unistd.h>

#include "renderer/reference/internal.h"

#define MOST_THREADS 256

/* Of modes isosurface and mesh, and within a volume. */
typedef struct ref_surface {
  tc_surface_source kind;
  int number;     /* of the scene's list */
  uint32_t label; /* 0: of no label */
  double iso, plane[4];
  tc_ref_triangles *triangles;   /* owned; of meshes */
  tc_ref_field field;            /* of a label; its `smooth` is owned, and NULL where the label is nowhere */
  double color[3], opacity;      /* compositing space */
  bool one_sided, colored;       /* colored: by the triangles' own colours */
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
  tc_volume *labelled;     /* that surfaces are of, or NULL */
  tc_scene scene;          /* copy of the labels' members; zero without labels */
  tc_ref_labels labels;
  ref_surface *surfaces; /* [n_surfaces] */
  size_t n_surfaces;
  bool within; /* the surfaces are in a volume that shows too */
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

static bool is_within(const tc_scene *s) {
  return s->mesh.n_surfaces && s->mesh.with_volume && (s->mode == TC_MODE_DVR || s->mode == TC_MODE_MIP);
}

/* Some surface that shows is of that source. */
static bool needs(const tc_scene *s, tc_surface_source source) {
  const bool mesh = s->mode == TC_MODE_MESH;
  for (size_t i = 0; i < s->mesh.n_surfaces && (mesh || is_within(s)); i++)
    if (shows(&s->mesh.surfaces[i]) && s->mesh.surfaces[i].source == source) return true;
  return mesh && source == TC_SURFACE_OF_LABEL && s->labels.volume[0] && !s->mesh.n_surfaces;
}

const char *tc_reference_missing(const tc_scene *scene) {
  bool surface = is_surface(scene->mode);
  if (scene->mode != TC_MODE_DVR && !surface && !is_projection(scene->mode)) return "/mode";
  surface = surface || is_within(scene);
  if ((unsigned)scene->filter >= TC_FILTER_COUNT || (surface && scene->filter != TC_FILTER_LINEAR)) return "/filter";
  if (needs(scene, TC_SURFACE_OF_LABEL) || needs(scene, TC_SURFACE_OF_MESH)) return "/mesh/surfaces";
  if (scene->labels.volume[0] && scene->mode == TC_MODE_DVR) return "/labels/volume";
  return NULL;
}

/* The plane of the slice that mode mpr shows in an orientation. */
static void plane_of(const tc_reference *r, const tc_scene *scene, tc_mpr_orientation orientation, double plane[4]) {
  static const double into[TC_MPR_ORIENTATION_COUNT][3] = {[TC_AXIAL] = {0, 0, 1}, [TC_CORONAL] = {0, 1, 0}, [TC_SAGITTAL] = {-1, 0, 0}};
  const tc_volume_desc *d = r->field.desc;
  double of[3];
  for (int k = 0; k < 3; k++) of[k] = orientation == TC_OBLIQUE ? -scene->mpr.normal[k] : into[orientation][k];
  double size = sqrt(of[0] * of[0] + of[1] * of[1] + of[2] * of[2]), at[3];
  plane[3] = 0;
  for (int k = 0; k < 3; k++) {
    at[k] = d->origin[k];
    for (int i = 0; i < 3; i++) at[k] += d->direction[3 * k + i] * d->spacing[i] * (d->dims[i] - 1) / 2;
    if (scene->mpr.has_center) at[k] = scene->mpr.center[k];
    plane[k] = of[k] / size, plane[3] -= plane[k] * at[k];
  }
}

static tc_ref_shading shading_of_surface(const tc_reference *r, const tc_scene *scene, const tc_mesh_surface *item) {
  tc_ref_shading shading;
  tc_scene own = *scene; /* borrows */
  if (item->own_shading & 1) own.shading.model = item->model;
  if (item->own_shading & 2) own.shading.ambient = item->ambient;
  if (item->own_shading & 4) own.shading.diffuse = item->diffuse;
  if (item->own_shading & 8) own.shading.specular = item->specular;
  if (item->own_shading & 16) own.shading.shininess = item->shininess;
  tc_ref_shading_set_up(&shading, r->volume, &own);
  if (scene->mode != TC_MODE_ISOSURFACE) tc_ref_shading_light(&shading, scene);
  return shading;
}

/* What surfaces are made of beside the scene's list. */
typedef struct sources {
  tc_volume *labels;
  const tc_reference_mesh *meshes;
  tc_ref_extent_of_label *extents; /* of labels; NULL: not needed */
} sources;

/* The label's field; of one that is nowhere none. */
static bool smooth_label(ref_surface *s, const sources *of, const tc_scene *scene) {
  const tc_ref_extent_of_label *where = NULL;
  for (int i = 0; i < TC_REF_LABELS && !where; i++)
    if (of->extents[i].found && of->extents[i].label == s->label) where = &of->extents[i];
  if (!where) return true;
  tc_ref_smooth *smooth = tc_ref_smooth_new(of->labels, where);
  if (!smooth) return false;
  s->field = (tc_ref_field){.desc = tc_ref_smooth_desc(smooth), .smooth = smooth};
  s->field.filter = TC_FILTER_LINEAR;
  tc_ref_shading dual;
  tc_ref_shading_set_up(&dual, of->labels, scene);
  memcpy(s->shading.dual, dual.dual, sizeof dual.dual);
  s->shading.gradient = TC_GRADIENT_CENTRAL;
  return true;
}

static bool add_surface(tc_reference *r, const tc_scene *scene, const tc_mesh_surface *item, const sources *of, GError **error) {
  const double *srgb = item->has_color ? item->color : scene->isosurface.color;
  const tc_mesh_surface *first = scene->mesh.surfaces;
  const bool listed = first && item >= first && item < first + scene->mesh.n_surfaces;
  ref_surface *s = &r->surfaces[r->n_surfaces++];
  *s = (ref_surface){.kind = item->source, .iso = item->value, .opacity = item->opacity, .one_sided = !item->two_sided};
  for (int c = 0; c < 3; c++) s->color[c] = scene->image.linear_light ? tc_ref_to_linear(srgb[c]) : srgb[c];
  s->number = listed ? (int)(item - first) : 0;
  if (item->source == TC_SURFACE_OF_LABEL) s->label = (uint32_t)item->label;
  if (item->source == TC_SURFACE_OF_LABEL && !item->has_color) tc_ref_label_color(of->labels, scene, item->label, s->color);
  if (item->source == TC_SURFACE_OF_PLANE) plane_of(r, scene, item->plane, s->plane);
  s->shading = shading_of_surface(r, scene, item);
  const tc_reference_mesh *mesh = item->source == TC_SURFACE_OF_MESH ? &of->meshes[s->number] : NULL;
  s->colored = mesh && mesh->colors && !item->has_color;
  if ((mesh && !(s->triangles = tc_ref_triangles_new(mesh, scene->image.linear_light))) ||
      (item->source == TC_SURFACE_OF_LABEL && !smooth_label(s, of, scene))) {
    tc_set_error(error, TC_ERROR_MEMORY, "/mesh/surfaces", "reference: no memory for the surfaces");
    return false;
  }
  if (isfinite(s->iso)) return true;
  tc_set_error(error, TC_ERROR_INVALID, "/isosurface/value", "reference: isosurface: a finite value expected");
  return false;
}

/* Without a list a mesh is every label's that shows: that list, g_free() it. */
static tc_mesh_surface *list_labels(const tc_scene *scene, const tc_ref_extent_of_label *extents, size_t *n) {
  tc_mesh_surface *list = g_new0(tc_mesh_surface, TC_REF_LABELS);
  *n = 0;
  for (int i = 0; i < TC_REF_LABELS; i++) {
    const double label = extents[i].label;
    bool shown = !scene->labels.visible;
    for (size_t k = 0; k < scene->labels.n_visible && !shown; k++) shown = scene->labels.visible[k] == label;
    if (extents[i].found && shown && label >= 1 && label <= INT32_MAX && label == floor(label))
      list[(*n)++] = (tc_mesh_surface){
          .source = TC_SURFACE_OF_LABEL, .label = (int)label, .opacity = 1, .visible = true, .two_sided = true};
  }
  return list;
}

static bool find_labels(tc_reference *r, sources *of, GError **error) {
  if (tc_volume_describe(of->labels)->type == TC_F32) {
    tc_set_error(error, TC_ERROR_INVALID, "/labels/volume", "reference: labels are whole numbers");
    return false;
  }
  r->labelled = tc_volume_ref(of->labels);
  of->extents = tc_ref_labels_find(of->labels, r->cancel);
  if (!of->extents)
    tc_set_error(error, TC_ERROR_MEMORY, "/labels/volume", "reference: no memory for the labels");
  else if (stopped(r))
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
  return of->extents && !stopped(r);
}

static bool add_surfaces(tc_reference *r, const tc_scene *scene, const sources *of, GError **error) {
  const tc_mesh_surface one = {.value = scene->isosurface.value, .opacity = 1, .visible = true, .two_sided = true};
  const bool listed = scene->mode != TC_MODE_ISOSURFACE && scene->mesh.n_surfaces;
  size_t n = listed ? scene->mesh.n_surfaces : 1;
  tc_mesh_surface *labels = !listed && of->extents ? list_labels(scene, of->extents, &n) : NULL;
  const tc_mesh_surface *list = listed ? scene->mesh.surfaces : labels ? labels : &one;
  bool good = true;
  r->surfaces = g_new0(ref_surface, n + 1);
  for (size_t i = 0; i < n && good; i++) {
    if (stopped(r)) tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
    good = !stopped(r) && (!shows(&list[i]) || add_surface(r, scene, &list[i], of, error));
  }
  g_free(labels);
  return good;
}

static bool set_up_surfaces(tc_reference *r, const tc_scene *scene, const tc_reference_request *given, GError **error) {
  sources of = {.labels = given->labels, .meshes = given->meshes};
  const bool good = (!needs(scene, TC_SURFACE_OF_LABEL) || find_labels(r, &of, error)) && add_surfaces(r, scene, &of, error);
  free(of.extents);
  return good;
}

/* Sets up what the mode reads: transfer function, window or surfaces; slices read the window too. */
static bool set_up_appearance(tc_reference *r, const tc_reference_request *of, GError **error) {
  const tc_scene *scene = of->scene;
  r->mode = scene->mode;
  r->within = is_within(scene);
  r->window = (tc_ref_window){scene->window.center, scene->window.width, scene->image.linear_light};
  if ((is_surface(scene->mode) || r->within) && !set_up_surfaces(r, scene, of, error)) return false;
  if (is_surface(scene->mode)) return true;
  if (!is_projection(scene->mode)) {
    if (tc_ref_transfer_set_up(&r->transfer, &scene->transfer_function, scene->image.linear_light)) return true;
    tc_set_error(error, TC_ERROR_INVALID, "/transferFunction",
                 "reference: transfer function: at least one knot expected, all "
                 "finite, values ascending");
    return false;
  }
  if (isfinite(r->window.center) && isfinite(r->window.width) && r->window.width > 0) return true;
  tc_set_error(error, TC_ERROR_INVALID, "/window", "reference: window: a finite center and a width above 0 expected");
  return false;
}

/* A member without a reference, or values that mean nothing: false with the error set. */
static bool check(const tc_reference_request *of, GError **error) {
  const char *member = tc_reference_missing(of->scene);
  const bool meshes = of->meshes || !needs(of->scene, TC_SURFACE_OF_MESH);
  const bool labels = of->labels || !needs(of->scene, TC_SURFACE_OF_LABEL);
  if (member && !(of->labels && !strcmp(member, "/labels/volume")) &&
      !(meshes && labels && !strcmp(member, "/mesh/surfaces"))) {
    tc_set_error(
        error, TC_ERROR_UNSUPPORTED, member,
        "reference: %s: only dvr, mip, minip and average of any field and surfaces of the linear one are "
        "integrated",
        member);
    return false;
  }
  if (of->width >= 1 && of->height >= 1 && (of->tolerance == 0 || (of->tolerance >= 1e-14 && of->tolerance <= 0.1)))
    return true;
  tc_set_error(error, TC_ERROR_INVALID, NULL, "reference: %dx%d pixels to %g: at least 1x1 and 1e-14 .. 0.1 expected",
               of->width, of->height, of->tolerance);
  return false;
}

static bool set_up_field(tc_reference *r, tc_volume *volume, const tc_scene *scene, GError **error) {
  r->field =
      (tc_ref_field){.filter = scene->filter, .desc = tc_volume_describe(volume), .voxels = tc_volume_data(volume)};
  if (tc_volume_gaps(volume) && is_surface(scene->mode)) r->field.gaps = tc_volume_data(tc_volume_gaps(volume));
  if (scene->filter != TC_FILTER_CUBIC || !scene->sampling.prefilter) return true;
  r->field.coefficients = tc_ref_coefficients(&r->field, r->cancel);
  if (stopped(r)) {
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
    return false;
  }
  if (!r->field.coefficients)
    tc_set_error(error, TC_ERROR_MEMORY, "/sampling/prefilter", "reference: no memory for the coefficients");
  return r->field.coefficients != NULL;
}

/* The labels of the scene, or the volume's gaps. */
static void set_up_labels(tc_reference *r, tc_volume *labels, const tc_scene *scene) {
  tc_volume *gaps = tc_volume_gaps(r->volume);
  if (labels && scene->labels.volume[0] && scene->mode == TC_MODE_DVR) {
    r->label_volume = tc_volume_ref(labels);
    tc_scene_copy(&r->scene, scene);
    tc_ref_labels_set_up(&r->labels, labels, &r->scene);
  } else if (gaps && !is_surface(scene->mode)) {
    r->label_volume = tc_volume_ref(gaps);
    r->scene.filter = scene->filter;
    tc_ref_labels_of_gaps(&r->labels, gaps, &r->scene);
  }
}

static bool set_up(tc_reference *r, const tc_reference_request *of, GError **error) {
  const tc_scene *scene = of->scene;
  r->cancel = of->cancel;
  r->volume = tc_volume_ref(of->volume);
  set_up_labels(r, of->labels, scene);
  if (!set_up_field(r, of->volume, scene, error)) return false;
  tc_ref_clip_set_up(&r->clip, scene);
  /* The errors of pieces add up, but each piece's estimate is pessimistic by orders of magnitude. */
  r->tolerance = (of->tolerance == 0 ? 1e-10 : of->tolerance) / 16;
  if (scene->mode == TC_MODE_DVR && scene->shading.model != TC_SHADING_NONE)
    tc_ref_shading_set_up(&r->shading, of->volume, scene);
  const char *member = tc_ref_camera_set_up(&r->camera, &scene->camera, of->width, of->height);
  if (!member) return set_up_appearance(r, of, error);
  tc_set_error(error, TC_ERROR_INVALID, member,
               "reference: camera: position, target and up must span a plane and the "
               "view be wider than 0 and narrower than 180 degrees");
  return false;
}

tc_reference *tc_reference_make(const tc_reference_request *request, GError **error) {
  if (!check(request, error)) return NULL;
  tc_reference *r = g_new0(tc_reference, 1);
  if (set_up(r, request, error)) return r;
  tc_reference_free(r);
  return NULL;
}

tc_reference *tc_reference_new(tc_volume *volume, const tc_scene *scene, int width, int height, double tolerance,
                               GError **error) {
  const tc_reference_request of = {
      .volume = volume, .scene = scene, .width = width, .height = height, .tolerance = tolerance};
  return tc_reference_make(&of, error);
}

void tc_reference_free(tc_reference *reference) {
  if (!reference) return;
  tc_ref_transfer_clear(&reference->transfer);
  tc_volume_unref(reference->volume);
  tc_volume_unref(reference->label_volume);
  tc_volume_unref(reference->labelled);
  tc_scene_clear(&reference->scene);
  g_free(reference->field.coefficients);
  for (size_t i = 0; i < reference->n_surfaces; i++) {
    tc_ref_triangles_free(reference->surfaces[i].triangles);
    tc_ref_smooth_free((tc_ref_smooth *)reference->surfaces[i].field.smooth);
  }
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

/* Grey of what there is of the field along the ray; false: nothing. */
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

/* ---- surfaces ---- */

static void cast(const tc_reference *r, double px, double py, tc_ref_cast *ray) {
  tc_ref_ray_cast(&r->camera, &r->clip, r->field.desc, px, py, ray);
}

/* The surface's next hit. */
typedef struct next_hit {
  tc_reference_hit hit;
  double t;
  int skip;
  bool met;
  bool bound; /* t is no more than the hit's: hit_surface() finds it */
  const tc_ref_field *field; /* that is met, of surfaces of values and labels, and where over its coordinates */
  double at[3];
} next_hit;

/* A slice's grey, as the window has it; what has no value is black. */
static void color_slice(const tc_reference *r, const double at[3], double color[3]) {
  double value, grey = tc_ref_value_at(&r->field, at, &value) && value == value ? tc_ref_window_grey(&r->window, value) : 0;
  for (int c = 0; c < 3; c++) color[c] = grey;
}

static bool meet_plane(const ref_surface *s, const tc_ref_ray *ray, next_hit *next, bool *back) {
  double apart = s->plane[3], rate = 0;
  for (int k = 0; k < 3; k++) apart += s->plane[k] * ray->lps[k], rate += s->plane[k] * ray->lps_direction[k];
  next->t = -apart / rate, *back = rate > 0;
  return next->skip++ == 0 && next->t >= ray->enter && next->t <= ray->leave;
}

static bool meet(const tc_reference *r, const ref_surface *s, const tc_ref_cast *ray, next_hit *next,
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

/* Where the ray meets the surface next; next starts as zeros. */
static bool hit_surface(const tc_reference *r, const ref_surface *s, const tc_ref_cast *cast, next_hit *next) {
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

/* The first hit, or only how far it is at least where the surface is a label's: its field is dear. */
static void begin_hits(const tc_reference *r, const tc_ref_cast *cast, next_hit *next) {
  for (size_t i = 0; i < r->n_surfaces; i++) {
    const ref_surface *s = &r->surfaces[i];
    tc_ref_ray own;
    if (s->kind != TC_SURFACE_OF_LABEL) hit_surface(r, s, cast, &next[i]);
    else if (s->field.smooth && tc_ref_ray_enter(&cast->open, s->field.desc, &own))
      next[i].met = next[i].bound = tc_ref_walk_bound(&s->field, &own, &next[i].t);
  }
}

/* Whose hit is next; n_surfaces: nobody's. */
static size_t find_nearest(const tc_reference *r, const tc_ref_cast *cast, next_hit *next) {
  for (;;) {
    size_t nearest = r->n_surfaces;
    for (size_t i = 0; i < r->n_surfaces; i++)
      if (next[i].met && (nearest == r->n_surfaces || next[i].t < next[nearest].t)) nearest = i;
    if (nearest == r->n_surfaces || !next[nearest].bound || stopped(r)) return nearest;
    hit_surface(r, &r->surfaces[nearest], cast, &next[nearest]);
  }
}

/* The nearest first hit of all surfaces, and whose it is; NULL: none. */
static const ref_surface *hit_nearest(const tc_reference *r, const tc_ref_cast *cast, tc_reference_hit *hit) {
  next_hit *next = g_new0(next_hit, r->n_surfaces + 1);
  begin_hits(r, cast, next);
  const size_t nearest = find_nearest(r, cast, next);
  *hit = next[nearest].hit;
  g_free(next);
  return nearest < r->n_surfaces ? &r->surfaces[nearest] : NULL;
}

bool tc_reference_surface(const tc_reference *r, double px, double py, tc_reference_hit *hit) {
  tc_ref_cast ray;
  if (!is_surface(r->mode)) return false;
  cast(r, px, py, &ray);
  return hit_nearest(r, &ray, hit);
}

/* What the ray has met so far; light.color and transparency are of surfaces and, in dvr, the volume. */
typedef struct blend {
  tc_ref_light light;
  double most; /* grey of the volume in mip; -1: none */
} blend;

/* Mip: a part as bright as m covers m of what is behind it, as far as it is brighter than those before. */
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

static void add_hit(const ref_surface *s, const tc_reference_hit *hit, blend *b) {
  const double share = b->light.transparency * (1 - fmax(b->most, 0)) * s->opacity;
  for (int c = 0; c < 3; c++) b->light.color[c] += share * hit->color[c];
  b->light.opacity += share;
  b->light.transparency *= 1 - s->opacity;
}

/* Every hit of every surface, the nearest first, and the volume between them. */
static void composite_surfaces(const tc_reference *r, const tc_ref_cast *ray, blend *b) {
  next_hit *next = g_new0(next_hit, r->n_surfaces + 1);
  tc_ref_ray part = ray->box;
  begin_hits(r, ray, next);
  while (b->light.transparency > 0 && !stopped(r)) {
    const size_t nearest = find_nearest(r, ray, next);
    const bool last = nearest == r->n_surfaces;
    part.leave = last ? ray->box.leave : fmin(ray->box.leave, next[nearest].t);
    if (r->within && ray->in_box) add_part(r, &part, b);
    if (last) break;
    add_hit(&r->surfaces[nearest], &next[nearest].hit, b);
    part.enter = fmax(part.enter, next[nearest].t);
    hit_surface(r, &r->surfaces[nearest], ray, &next[nearest]);
  }
  g_free(next);
}

void tc_reference_pixel(const tc_reference *r, double px, double py, double rgba[4]) {
  blend b = {.light.transparency = 1, .most = -1};
  tc_ref_cast ray;
  double grey;
  cast(r, px, py, &ray);
  memset(rgba, 0, 4 * sizeof *rgba);
  if (r->n_surfaces) {
    composite_surfaces(r, &ray, &b);
  } else if (ray.in_box && is_projection(r->mode)) {
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
static void list_surface(const tc_reference *r, const tc_ref_cast *cast, GArray *list) {
  tc_reference_hit hit;
  const tc_ref_ray *ray = &cast->box;
  const ref_surface *met = hit_nearest(r, cast, &hit);
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
  cast(r, px, py, &of);
  const tc_ref_ray ray = of.box;
  if (of.in_box && is_surface(r->mode)) {
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
    tc_set_error(error, TC_ERROR_INVALID, NULL, "reference: %d threads: 0 to %d expected", threads, MOST_THREADS);
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
