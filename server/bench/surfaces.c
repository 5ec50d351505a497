#include "server/bench/surfaces.h"

#include <math.h>
#include <string.h>

#include "renderer/mesh/measure.h"
#include "renderer/quality/depths.h"
#include "renderer/reference/reference.h"
#include "server/bench/parallel.h"
#include "server/bench/timing.h"

enum { LEVELS = 7 };
static const double errors_voxels[LEVELS] = {0, 0.02, 0.05, 0.1, 0.25, 0.5, 1}; /* of quadrics, in voxels */

/* ---- errors ---- */

typedef struct measuring {
  tc_renderer *renderer;
  tc_volume *volume;
  const tc_depths *truth;
  int runs, side;
} measuring;

typedef struct roots {
  const tc_reference *reference;
  const tc_scene *scene;
  int side;
  tc_depths *pixels;
} roots;

static void find_row(void *context, int y) {
  const roots *r = context;
  for (int x = 0; x < r->side; x++) tc_depths_exact(r->reference, r->scene, x, y, &r->pixels[y * r->side + x]);
}

/* The exact depths of the scene's isosurface, [side][side]; caller frees with g_free(). */
static tc_depths *find_truth(tc_volume *volume, const tc_scene *scene, int side, int threads, GError **error) {
  tc_scene own = *scene; /* borrows the lists of *scene */
  own.mode = TC_MODE_ISOSURFACE, own.sampling.rays_per_pixel = 1;
  tc_reference *reference = tc_reference_new(volume, &own, side, side, 0, error);
  if (!reference) return NULL;
  roots r = {reference, &own, side, g_new0(tc_depths, (size_t)side *(size_t)side)};
  tcs_parallel(threads, side, find_row, &r);
  tc_reference_free(reference);
  return r.pixels;
}

static void compare(const measuring *m, const float *depth, tc_depth_error *off) {
  const int n = m->side * m->side;
  tc_depths *pixels = g_memdup2(m->truth, (size_t)n * sizeof *pixels);
  for (int i = 0; i < n; i++) pixels[i].drawn = (double)depth[i];
  tc_depths_compare(pixels, n, off, NULL, 0);
  g_free(pixels);
}

/* ---- triangles ---- */

/* The shortest of several frames, after one that builds the resources, and the error of a picture. */
static cJSON *measure(const measuring *m, const tc_scene *scene, tc_mesh *mesh, GError **error) {
  tc_mesh *const meshes[1] = {mesh};
  tc_render_request request = {.meshes = mesh ? meshes : NULL};
  tc_frame frame = {0};
  tc_depth_error off;
  double ms = INFINITY;
  bool good = true;
  for (int i = 0; i <= m->runs && good; i++) {
    good = tc_render(m->renderer, m->volume, scene, &request, &frame, error);
    if (i) ms = fmin(ms, frame.stats.render_ms);
  }
  request.width = request.height = m->side, request.want_depth = true;
  good = good && tc_render(m->renderer, m->volume, scene, &request, &frame, error);
  if (good) compare(m, frame.depth, &off);
  tc_frame_finish(&frame);
  if (!good) return NULL;
  cJSON *json = cJSON_CreateObject();
  if (mesh) cJSON_AddNumberToObject(json, "triangles", (double)mesh->n_triangles);
  cJSON_AddNumberToObject(json, "ms", ms);
  cJSON_AddNumberToObject(json, "outline", off.outline);
  cJSON_AddNumberToObject(json, "depthRmsMm", off.rms);
  cJSON_AddNumberToObject(json, "depthP50Mm", off.p50);
  cJSON_AddNumberToObject(json, "depthP99Mm", off.p99);
  cJSON_AddNumberToObject(json, "depthMaxMm", off.max);
  return json;
}

/* Draws the mesh as the only surface of a list. */
static bool measure_mesh(const measuring *m, const tc_scene *scene, tc_mesh *mesh, double error_mm, cJSON *to,
                         GError **error) {
  tc_mesh_surface surface = {
      .source = TC_SURFACE_OF_MESH, .mesh = "simplified", .opacity = 1, .visible = true, .two_sided = true};
  tc_scene own;
  tc_scene_copy(&own, scene);
  own.mode = TC_MODE_MESH;
  memcpy(surface.color, own.isosurface.color, sizeof surface.color);
  surface.has_color = true;
  tc_scene_set_surfaces(&own, g_memdup2(&surface, sizeof surface), 1);
  cJSON *json = measure(m, &own, mesh, error);
  tc_scene_clear(&own);
  if (json) cJSON_AddNumberToObject(json, "errorMm", error_mm), cJSON_AddItemToArray(to, json);
  return json != NULL;
}

typedef struct simplifying {
  double voxel; /* mm */
  tc_mesh *level[LEVELS];
  GError *error[LEVELS];
} simplifying;

/* The coarsest level first, since it takes longest. */
static void simplify(void *context, int index) {
  simplifying *s = context;
  const int i = LEVELS - 1 - index;
  if (i) s->level[i] = tc_mesh_simplify(s->level[0], errors_voxels[i] * s->voxel, 0, &s->error[i]);
}

static bool measure_levels(const measuring *m, const tc_scene *scene, cJSON *to, GError **error) {
  const double *spacing = tc_volume_describe(m->volume)->spacing;
  simplifying s = {.voxel = fmin(spacing[0], fmin(spacing[1], spacing[2]))};
  s.level[0] = tc_mesh_extract(m->volume, scene->isosurface.value, &(tc_mesh_options){.normals = true}, &s.error[0]);
  if (s.level[0]) tcs_parallel(tc_renderer_about(m->renderer)->threads, LEVELS, simplify, &s);
  bool good = true;
  for (int i = 0; i < LEVELS && good; i++) {
    tc_mesh *mesh = s.level[i];
    if (!mesh) g_propagate_error(error, g_steal_pointer(&s.error[i]));
    good = mesh && (!mesh->n_triangles || measure_mesh(m, scene, mesh, errors_voxels[i] * s.voxel, to, error));
    if (mesh) tc_renderer_forget_mesh(m->renderer, mesh->serial);
  }
  for (int i = 0; i < LEVELS; i++) tc_mesh_free(s.level[i]), g_clear_error(&s.error[i]);
  return good;
}

cJSON *tcs_surface_levels(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int runs, int side,
                          GError **error) {
  tc_depths *truth = find_truth(volume, scene, side, tc_renderer_about(renderer)->threads, error);
  if (!truth) return NULL;
  const measuring m = {renderer, volume, truth, runs, side};
  cJSON *json = cJSON_CreateArray(), *rays = NULL;
  tc_scene own;
  tc_scene_copy(&own, scene);
  own.mode = TC_MODE_ISOSURFACE;
  const bool good = measure_levels(&m, scene, json, error) && (rays = measure(&m, &own, NULL, error));
  tc_scene_clear(&own);
  g_free(truth);
  if (good) {
    cJSON_AddItemToArray(json, rays);
    return json;
  }
  cJSON_Delete(json);
  return NULL;
}
