#include "renderer/frame/mesh_job.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/classify/transfer.h"
#include "renderer/mesh/levels.h"
#include "renderer/mesh/pick.h"
#include "renderer/mesh/sight.h"
#include "renderer/raycast/mpr.h"
#include "renderer/raycast/shading.h"

static void to_compositing_space(const tc_scene *scene, const double srgb[3], float color[3]) {
  for (int c = 0; c < 3; c++) color[c] = (float)(scene->image.linear_light ? tc_srgb_to_linear(srgb[c]) : srgb[c]);
}

/* Converts light i of the scene and the shading parameters s (shading.h) for the rasteriser. */
static void add_light(const tc_scene *scene, const tc_mesh_view *view, const tc_shade *s, int i, tc_raster_look *look) {
  static const tc_mesh_light white = {.color = {1, 1, 1}, .intensity = 1};
  const tc_mesh_light *of = scene->mesh.n_lights ? &scene->mesh.lights[i] : &white;
  const double *rows[3] = {view->right, view->down, view->depth};
  look->lights[i].at_camera = s->head_light;
  to_compositing_space(scene, of->color, look->lights[i].color);
  for (int k = 0; k < 3; k++) {
    const double to[3] = {(double)s->light[0], (double)s->light[1], (double)s->light[2]};
    look->lights[i].to[k] = (float)(rows[k][0] * to[0] + rows[k][1] * to[1] + rows[k][2] * to[2]);
    look->lights[i].color[k] *= (float)of->intensity;
  }
}

/* item: surface of the scene's list whose overrides apply; NULL: none. */
static tc_raster_look look_of(const tc_frame_job *job, const tc_mesh_view *view, const tc_mesh_surface *item) {
  tc_scene own = *job->scene; /* borrows */
  const unsigned its = item ? item->own_shading : 0;
  if (its & 1) own.shading.model = item->model;
  if (its & 2) own.shading.ambient = item->ambient;
  if (its & 4) own.shading.diffuse = item->diffuse;
  if (its & 8) own.shading.specular = item->specular;
  if (its & 16) own.shading.shininess = item->shininess;
  tc_raster_look look = {.shaded = own.shading.model != TC_SHADING_NONE};
  look.n_lights = own.mesh.n_lights ? own.mesh.n_lights : 1;
  for (int i = 0; i < look.n_lights && look.shaded; i++) {
    tc_shade s;
    if (own.mesh.n_lights) {
      own.shading.light_at_camera = own.mesh.lights[i].at_camera;
      memcpy(own.shading.light, own.mesh.lights[i].direction, sizeof own.shading.light);
    }
    tc_shade_set_up(&s, job->source, job->source, &own);
    add_light(&own, view, &s, i, &look);
    memcpy(look.factor, s.factor, sizeof look.factor);
    for (int k = 0; k < 2; k++) memcpy(look.glow[k], s.glow[k], sizeof look.glow[k]);
    look.least = s.least, look.specular = s.specular, look.shininess = s.shininess;
  }
  return look;
}

/* The plane of the slice that mode mpr shows in an orientation. */
static void plane_of(const tc_frame_job *job, tc_mpr_orientation orientation, double plane[4]) {
  const tc_volume_desc *d = tc_volume_describe(job->source);
  tc_scene slice = *job->scene; /* borrows */
  double right[3], up[3], middle[3], at[3];
  slice.mpr.orientation = orientation;
  tc_slice_basis(&slice, right, up, plane);
  for (int k = 0; k < 3; k++) middle[k] = 0.5 * (d->dims[k] - 1);
  tc_volume_index_to_lps(job->source, middle, at);
  if (slice.mpr.has_center) memcpy(at, slice.mpr.center, sizeof at);
  plane[3] = -(plane[0] * at[0] + plane[1] * at[1] + plane[2] * at[2]);
}

/* The windowed grey of a slice at a position; black where the volume has no value. */
static void grey_at(const void *user, const double at[3], float color[3]) {
  const tc_mesh_job *m = user;
  const tc_volume_desc *d = tc_volume_describe(m->job->source);
  double lps[3], index[3], value;
  for (int k = 0; k < 3; k++) lps[k] = at[k] + m->job->have.mesh->origin[k];
  tc_volume_lps_to_index(m->job->source, lps, index);
  for (int k = 0; k < 3; k++) index[k] = fmin(fmax(index[k], 0), d->dims[k] - 1); /* corners of the slice's outline are
                                                                                     rounded */
  const tc_slice_window *w = &m->window;
  if (!tc_volume_value_at(m->job->source, index, &value)) value = NAN;
  const double node = fmin(fmax(((value - d->intercept) / d->slope - (double)w->lo) * (double)w->sign, 0), (double)w->last);
  double grey = fmin(fmax((node - (double)w->center) * (double)w->gain + 0.5, 0), 1);
  if (m->job->scene->image.linear_light) grey = tc_srgb_to_linear(grey);
  for (int c = 0; c < 3; c++) color[c] = value == value ? (float)grey : 0;
}

size_t tc_mesh_sources(const tc_frame_job *job, tc_mesh_source *of) {
  size_t n = 0;
  for (size_t i = 0; i < job->scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *s = &job->scene->mesh.surfaces[i];
    if (!tc_mesh_surface_shows(s)) continue;
    of[n] = (tc_mesh_source){.kind = s->source};
    if (s->source == TC_SURFACE_OF_VALUE) of[n].iso = s->value, of[n].serial = tc_volume_serial(job->source);
    if (s->source == TC_SURFACE_OF_MESH && job->meshes)
      of[n].mesh = job->meshes[i], of[n].serial = job->meshes[i]->serial;
    if (s->source == TC_SURFACE_OF_LABEL)
      of[n].label = (uint32_t)s->label, of[n].serial = tc_volume_serial(job->label_volume);
    if (s->source == TC_SURFACE_OF_PLANE) plane_of(job, s->plane, of[n].plane), of[n].serial = tc_volume_serial(job->source);
    n++;
  }
  return n;
}

static void label_color(const tc_frame_job *job, uint32_t label, float color[3]) {
  const tc_volume_desc *d = tc_volume_describe(job->label_volume);
  const double entry = (label - d->intercept) / d->slope - job->have.labels->base;
  const float *e = job->have.labels->entries[entry >= 0 && entry < job->have.labels->n ? (int)entry : job->have.labels->n];
  memcpy(color, e + 5, 3 * sizeof *color);
}

/* A part's entry in the scene's list; NULL without a list. */
static const tc_mesh_surface *item_of(const tc_scene *scene, size_t part) {
  const tc_mesh_surface *item = scene->mesh.surfaces, *end = item + scene->mesh.n_surfaces;
  for (; item < end; item++)
    if (tc_mesh_surface_shows(item) && part-- == 0) return item;
  return NULL;
}

/* item: the part's entry in the scene's list, or NULL. closed: if opaque, its back faces are never visible. */
static bool is_one_sided(const tc_mesh_surface *item, bool closed) {
  return (closed && !(item && item->opacity < 1)) || (item && !item->two_sided);
}

static tc_raster_surface surface_of(const tc_frame_job *job, const tc_part *part, const tc_mesh_surface *item, bool closed) {
  tc_raster_surface s = {.opacity = item ? (float)item->opacity : 1, .textured = part->of.kind == TC_SURFACE_OF_PLANE};
  s.one_sided = is_one_sided(item, closed);
  if (item && item->has_color)
    to_compositing_space(job->scene, item->color, s.color);
  else if (part->of.kind == TC_SURFACE_OF_LABEL)
    label_color(job, part->of.label, s.color);
  else
    memcpy(s.color, job->plan->surface.color, sizeof s.color);
  s.colored = part->colored && !(item && item->has_color);
  return s;
}

static void set_channels(tc_mesh_job *m, const tc_scene *scene) {
  for (int i = 0; i < 256 && !m->raster.channels; i++)
    m->channels[i] = (float)(scene->image.linear_light ? tc_srgb_to_linear(i / 255.0) : i / 255.0);
  m->raster.channels = m->channels;
}

/* Fills a surface for each part of the mesh, and the looks: first the scene's, then those of surfaces that override
 * it. */
static bool set_surfaces(tc_mesh_job *m, const tc_frame_job *job, bool from_outside) {
  const tc_clusters *mesh = job->have.mesh;
  m->surfaces = calloc(mesh->n_parts, sizeof *m->surfaces);
  m->looks = calloc(job->scene->mesh.n_surfaces + 1, sizeof *m->looks);
  if (!m->surfaces || !m->looks) return false;
  m->looks[0] = look_of(job, &m->view, NULL), m->n_looks = 1;
  for (size_t i = 0; i < mesh->n_parts; i++) {
    const tc_mesh_surface *own = item_of(job->scene, i);
    m->surfaces[i] = surface_of(job, &mesh->parts[i], own, from_outside && mesh->parts[i].closed);
    if (m->surfaces[i].colored) set_channels(m, job->scene);
    if (!own || !own->own_shading) continue;
    m->looks[m->n_looks] = look_of(job, &m->view, own), m->surfaces[i].look = m->n_looks++;
  }
  return true;
}

/* The scene's clip box and planes, in LPS. */
static int planes_of(const tc_scene *scene, double planes[TC_VIEW_MOST_CLIP][4]) {
  int n = 0;
  memset(planes, 0, TC_VIEW_MOST_CLIP * sizeof *planes);
  for (int k = 0; k < 3 && scene->clip.has_box; k++) {
    planes[n][k] = 1, planes[n++][3] = -scene->clip.box[0][k];
    planes[n][k] = -1, planes[n++][3] = scene->clip.box[1][k];
  }
  for (int i = 0; i < scene->clip.n_planes; i++) memcpy(planes[n++], scene->clip.planes[i], sizeof *planes);
  return n;
}

/* A label's smooth surface reaches beyond the label volume's outer voxels by less than this. */
#define SMOOTH_REACH 4

/* Whether all points, moved by `by`, are outside the view or clipped, by one plane. Looks no further than it takes; adds the
 * number of points it looked at to *looked_at. */
static bool all_outside(const tc_mesh_view *v, const float (*points)[3], size_t n, const double by[3], uint64_t *looked_at) {
  double planes[4 + 1 + TC_VIEW_MOST_CLIP][4];
  unsigned left = 0;
  size_t i = 0;
  memcpy(planes, v->sides, sizeof v->sides);
  memcpy(planes[4], v->depth, sizeof v->depth), planes[4][3] += v->reference; /* what is behind the eye */
  const int n_planes = 5 + v->n_planes - TC_VIEW_CLIP;
  for (int p = 5; p < n_planes; p++) memcpy(planes[p], v->planes[TC_VIEW_CLIP + p - 5], sizeof planes[p]);
  for (int p = 0; p < n_planes; p++) left |= 1u << p;
  for (; i < n && left; i++) {
    double at[3], size = 0;
    for (int k = 0; k < 3; k++) at[k] = (double)points[i][k] + by[k], size += fabs(at[k]);
    for (int p = 0; p < n_planes; p++)
      if (!(tc_mesh_view_row(planes[p], at) < -1e-6 * size)) left &= ~(1u << p);
  }
  *looked_at += i;
  return left != 0;
}

/* The view of a volume's box, `reach` voxels wider, whose corners are relative to box->origin. */
static void view_box(const tc_frame_job *job, const tc_volume *volume, double reach, tc_mesh_view *view, tc_clusters *box, float corners[8][3]) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  double middle[3], at[3], planes[TC_VIEW_MOST_CLIP][4];
  *box = (tc_clusters){0}; /* empty, with the box's centre and bounding sphere */
  for (int k = 0; k < 3; k++) middle[k] = 0.5 * (d->dims[k] - 1);
  tc_volume_index_to_lps(volume, middle, box->origin);
  for (int c = 0; c < 8; c++) {
    double index[3], apart = 0;
    for (int k = 0; k < 3; k++) index[k] = c >> k & 1 ? d->dims[k] - 1 + reach : -reach;
    tc_volume_index_to_lps(volume, index, at);
    for (int k = 0; k < 3; k++) corners[c][k] = (float)(at[k] - box->origin[k]), apart += (at[k] - box->origin[k]) * (at[k] - box->origin[k]);
    box->radius = fmaxf(box->radius, (float)sqrt(apart));
  }
  tc_mesh_view_set_up(view, box, &job->scene->camera, job->plan->width, job->plan->height);
  tc_mesh_view_clip(view, box, (const double(*)[4])planes, planes_of(job->scene, planes));
}

static bool box_in_view(const tc_frame_job *job, const tc_volume *volume, double reach) {
  tc_mesh_view view;
  tc_clusters box;
  float corners[8][3];
  uint64_t looked_at = 0;
  view_box(job, volume, reach, &view, &box, corners);
  return !all_outside(&view, (const float(*)[3])corners, 8, (const double[3]){0}, &looked_at);
}

static bool mesh_in_view(const tc_frame_job *job, const tc_mesh *mesh) {
  tc_mesh_view view;
  tc_clusters box;
  float corners[8][3];
  double by[3];
  uint64_t of_box = 0;
  view_box(job, job->source, 0, &view, &box, corners);
  for (int k = 0; k < 3; k++) by[k] = mesh->origin[k] - box.origin[k];
  for (int c = 0; c < 8; c++)
    for (int k = 0; k < 3; k++) corners[c][k] = c >> k & 1 ? mesh->high[k] : mesh->low[k];
  if (mesh->boxed && all_outside(&view, (const float(*)[3])corners, 8, by, &of_box)) return false;
  return !all_outside(&view, (const float(*)[3])mesh->positions, mesh->n_vertices, by, &job->frame->stats.looked_at);
}

bool tc_mesh_in_view(const tc_frame_job *job) {
  bool others = !job->scene->mesh.n_surfaces;
  for (size_t i = 0; i < job->scene->mesh.n_surfaces; i++) {
    const tc_mesh_surface *s = &job->scene->mesh.surfaces[i];
    const bool given = s->source == TC_SURFACE_OF_MESH, shows = tc_mesh_surface_shows(s);
    if (shows && given && job->meshes && mesh_in_view(job, job->meshes[i])) return true;
    others = others || (shows && !given);
  }
  return others && (box_in_view(job, job->source, 0) || (job->label_volume && box_in_view(job, job->label_volume, SMOOTH_REACH)));
}

void tc_mesh_count(const tc_clusters *mesh, const tc_plan *plan, const tc_scene *scene, tc_facts *facts) {
  const double slack = tc_sight_slack(mesh);
  double planes[TC_VIEW_MOST_CLIP][4];
  uint8_t *levels = calloc(mesh->n_groups + 1, 1);
  bool *one_sided = calloc(mesh->n_parts + 1, sizeof *one_sided), away;
  tc_mesh_view view;
  tc_mesh_view_set_up(&view, mesh, &scene->camera, plan->width, plan->height);
  const int n_planes = planes_of(scene, planes);
  tc_mesh_view_clip(&view, mesh, (const double(*)[4])planes, n_planes);
  if (levels && one_sided) {
    if (mesh->n_groups) {
      facts->triangles = tc_levels_choose(mesh, &view, plan->mesh_pixels, levels);
      facts->triangles_in_full = tc_clusters_in_full(mesh);
    }
    const bool from_outside = n_planes == 0 && tc_mesh_view_is_outside(&view, mesh);
    for (size_t i = 0; i < mesh->n_parts; i++)
      one_sided[i] = is_one_sided(item_of(scene, i), from_outside && mesh->parts[i].closed);
    for (size_t i = 0; i < mesh->n; i++) {
      const tc_cluster *k = &mesh->clusters[i];
      if (mesh->n_groups && k->level != levels[k->group]) continue;
      const tc_sight s = tc_sight_of(&view, k, slack, one_sided[k->part], &away);
      facts->clusters++;
      if (s.x1 < s.x0) *(away ? &facts->facing_away : &facts->outside) += 1;
    }
  }
  free(levels), free(one_sided);
}

#define BEHIND 0.25 /* finest voxels: the surfaces of two labels have the same vertices where the labels meet, but not the same triangles */

static double behind_of(const tc_frame_job *job) {
  const tc_clusters *mesh = job->have.mesh;
  size_t n = 0;
  for (size_t i = 0; i < mesh->n_parts; i++) n += mesh->parts[i].of.kind == TC_SURFACE_OF_LABEL;
  if (n < 2) return 0;
  const double *spacing = tc_volume_describe(job->label_volume)->spacing;
  return BEHIND * fmin(spacing[0], fmin(spacing[1], spacing[2]));
}

bool tc_mesh_job_begin(tc_mesh_job *m, const tc_frame_job *job, GError **error) {
  const tc_clusters *mesh = job->have.mesh;
  double planes[TC_VIEW_MOST_CLIP][4];
  const int n_planes = planes_of(job->scene, planes);
  m->raster.channels = NULL;
  tc_mesh_view_set_up(&m->view, mesh, &job->scene->camera, job->frame->width, job->frame->height);
  tc_mesh_view_clip(&m->view, mesh, (const double(*)[4])planes, n_planes);
  m->view.behind = behind_of(job);
  m->levels = mesh->n_groups ? malloc(mesh->n_groups) : NULL;
  if (m->levels) tc_levels_choose(mesh, &m->view, job->plan->mesh_pixels, m->levels);
  if (!set_surfaces(m, job, n_planes == 0 && tc_mesh_view_is_outside(&m->view, mesh))) {
    tc_mesh_job_end(m);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "surfaces of a mesh: out of memory");
    return false;
  }
  for (int i = 0; i < job->rays->count; i++)
    m->samples[i][0] = job->rays->of_pixel[i].x, m->samples[i][1] = job->rays->of_pixel[i].y;
  m->job = job;
  tc_slice_window_init(&m->window, job->source, job->scene);
  m->raster = (tc_raster_job){.mesh = mesh,
                              .view = &m->view,
                              .looks = m->looks,
                              .n_looks = m->n_looks,
                              .surfaces = m->surfaces,
                              .channels = m->raster.channels,
                              .levels = m->levels,
                              .ledger = job->ledger,
                              .texture = grey_at,
                              .texture_user = m,
                              .n_samples = job->rays->count,
                              .want_depth = job->plan->depth,
                              .samples = (const double(*)[2])m->samples};
  return true;
}

void tc_mesh_job_end(tc_mesh_job *m) { free(m->surfaces), free(m->looks), free(m->levels); }

/* Picking ignores surfaces of lower opacity, as it ignores faint haze in dvr. */
#define LEAST_OPACITY 0.05

bool tc_mesh_job_pick(const tc_frame_job *job, tc_pick *pick, GError **error) {
  tc_mesh_job m;
  tc_mesh_hit hit;
  *pick = (tc_pick){.at = {pick->at[0], pick->at[1]}, .surface = -1, .value = NAN};
  if (!tc_mesh_job_begin(&m, job, error)) return false;
  pick->found = tc_mesh_pick(job->have.mesh, &m.view, m.surfaces, LEAST_OPACITY, pick->at, &hit);
  tc_mesh_job_end(&m);
  if (!pick->found) return true;
  const tc_mesh_source *of = &job->have.mesh->parts[hit.part].of;
  double index[3];
  memcpy(pick->position, hit.position, sizeof pick->position);
  pick->distance_mm = hit.distance_mm;
  const tc_mesh_surface *item = item_of(job->scene, hit.part);
  if (item) pick->surface = (int)(item - job->scene->mesh.surfaces);
  if (of->kind == TC_SURFACE_OF_VALUE) pick->value = of->iso;
  if (of->kind == TC_SURFACE_OF_LABEL) pick->label = of->label;
  tc_volume_lps_to_index(job->source, hit.position, index);
  if (of->kind == TC_SURFACE_OF_PLANE && !tc_volume_value_at(job->source, index, &pick->value)) pick->value = NAN;
  return true;
}
