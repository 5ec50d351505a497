/* Queries of one pixel: ray record and pick, by the reference integrator where a mode has one, off the render thread. */
#include <string.h>

#include "renderer/raycast/mpr.h"
#include "renderer/reference/reference.h"
#include "renderer/splat/pick.h"
#include "renderer/splat/vmd.h"

#include "server/config/config.h"
#include "server/http/ray_json.h"
#include "server/http/work.h"
#include "server/session/sessions.h"

/* A pick hits where the ray's opacity reaches this value; thinner haze is passed through. */
#define VISIBLE_OPACITY 0.05

/* Limits on waiting probes: per session, and in all. */
#define SESSION_PROBES 16
#define MOST_PROBES 64

typedef struct probe {
  tcs_work work;
  tcs_server *server;
  char session[40];           /* the id, since the session may end while the probe waits */
  tc_volume *volume, *labels; /* labels may be NULL */
  tc_scene scene;
  int x, y;
  cJSON *surface; /* of a pick: the hit of the drawn surface, at this distance; or NULL */
  double surface_mm;
} probe;

static void free_probe(tcs_work *work) {
  probe *p = (probe *)work;
  tcs_session *session = tcs_sessions_find(p->server->sessions, p->session);
  if (session) session->probes--;
  tc_scene_clear(&p->scene);
  cJSON_Delete(p->surface);
  tc_volume_unref(p->volume);
  tc_volume_unref(p->labels);
}

/* Parses the pixel from the query, for a picture of the query's size or the scene's. False: replied. */
static bool read_pixel(tcs_request *request, const tcs_session *session, tcs_pixel *at) {
  const tcs_limits *limits = &request->server->config->limits;
  *at = (tcs_pixel){.width = session->scene.image.width, .height = session->scene.image.height};
  if (!tcs_query(request, "x") || !tcs_query(request, "y")) {
    tcs_reply_problem(request, 422, "invalid", "Invalid value",
                      "query x and y: give a pixel, 0 at the left and at the top");
    return false;
  }
  return tcs_query_int(request, "width", 1, (int)limits->image_side, &at->width) &&
         tcs_query_int(request, "height", 1, (int)limits->image_side, &at->height) &&
         tcs_query_int(request, "x", 0, at->width - 1, &at->x) &&
         tcs_query_int(request, "y", 0, at->height - 1, &at->y);
}

/* surface: taken, at distance surface_mm; NULL: none. */
static void start_probe(tcs_request *request, tcs_session *session, void (*run)(tcs_work *work), cJSON *surface,
                        double surface_mm) {
  tcs_pixel at;
  if (!read_pixel(request, session, &at)) {
    cJSON_Delete(surface);
    return;
  }
  probe *p = g_new0(probe, 1);
  *p = (probe){.work = {.run = run, .free = free_probe}, .server = request->server, .x = at.x, .y = at.y, .surface = surface,
               .surface_mm = surface_mm};
  g_strlcpy(p->session, session->id, sizeof p->session);
  p->volume = tc_volume_ref(tcs_entry_shown(session->entry, &session->scene));
  if (session->labels) p->labels = tc_volume_ref(tcs_session_labels(session));
  tc_scene_copy(&p->scene, &session->scene);
  p->scene.image.width = at.width;
  p->scene.image.height = at.height;
  const bool many = session->probes++ >= SESSION_PROBES;
  tcs_work_start(request, request->server->probe_worker, &p->work, many ? 0 : MOST_PROBES);
}

/* Traces the ray through the pixel's centre; NULL with the error set. */
static tc_reference *trace(probe *p, tc_reference_sample **samples, size_t *count) {
  const tc_reference_request of = {.volume = p->volume,
                                   .labels = p->labels,
                                   .scene = &p->scene,
                                   .width = p->scene.image.width,
                                   .height = p->scene.image.height,
                                   .cancel = &p->work.cancel};
  tc_reference *r = tc_reference_make(&of, &p->work.error);
  if (r) tc_reference_ray(r, p->x + 0.5, p->y + 0.5, samples, count);
  return r;
}

static void run_ray(tcs_work *work) {
  probe *p = (probe *)work;
  work->text = tcs_ray_json(p->volume, p->labels, &p->scene, (int[]){p->x, p->y}, &work->cancel, &work->error);
}

/* The first piece behind which the opacity reaches VISIBLE_OPACITY; if none, the first piece with any opacity. */
static const tc_reference_sample *first_visible(const tc_reference_sample *samples, size_t count) {
  const tc_reference_sample *haze = NULL;
  for (size_t i = 0; i < count; i++) {
    if (!haze && samples[i].extinction > 0) haze = &samples[i];
    if (i + 1 < count && 1 - samples[i + 1].transparency >= VISIBLE_OPACITY) return &samples[i];
  }
  return haze;
}

/* The sample that a projection shows: the largest value for mip, the smallest for minip, at the end of a piece since
 * pieces are monotone; for average, where the whole ray contributes, the ray's entry. */
static const tc_reference_sample *shown(tc_mode mode, tc_reference_sample *samples, size_t count) {
  if (count == 0 || mode == TC_MODE_AVERAGE) return samples;
  double sign = mode == TC_MODE_MIP ? 1 : -1;
  size_t best = 0;
  for (size_t i = 1; i < count; i++)
    if (sign * samples[i].value > sign * samples[best].value) best = i;
  tc_reference_sample *first = samples, *last = samples + count - 1;
  if (sign * last->value_back <= sign * samples[best].value || count == 1) return samples + best;
  for (int k = 0; k < 3; k++) /* extrapolated to the end of the ray */
    last->position[k] +=
        (last->position[k] - first->position[k]) / (last->distance_mm - first->distance_mm) * last->length_mm;
  last->distance_mm += last->length_mm;
  last->value = last->value_back;
  return last;
}

/* The first hit of the isosurface, as a sample. */
static const tc_reference_sample *surface_of(const probe *p, const tc_reference *r, tc_reference_sample *at) {
  tc_reference_hit hit;
  if (!tc_reference_surface(r, p->x + 0.5, p->y + 0.5, &hit)) return NULL;
  *at = (tc_reference_sample){.distance_mm = hit.distance_mm, .value = p->scene.isosurface.value};
  memcpy(at->position, hit.position, sizeof at->position);
  return at;
}

/* hit NULL: nothing visible. */
static cJSON *pick_json(const tc_reference_sample *hit) {
  cJSON *json = cJSON_CreateObject();
  if (hit) {
    cJSON_AddItemToObject(json, "position", cJSON_CreateDoubleArray(hit->position, 3));
    cJSON_AddNumberToObject(json, "value", hit->value);
    cJSON_AddNumberToObject(json, "depth", hit->distance_mm);
  } else {
    cJSON_AddNullToObject(json, "position");
    cJSON_AddNullToObject(json, "value");
    cJSON_AddNullToObject(json, "depth");
  }
  return json;
}

/* The attributes of a voxel: normals as vectors (LPS), others as their stored numbers. */
static cJSON *attributes_json(const tc_vmd *model, const int at[3]) {
  cJSON *json = cJSON_CreateObject();
  const uint8_t *record = tc_vmd_voxel(model, at[0], at[1], at[2]);
  for (int i = 0; i < model->head.n_attributes && record; i++) {
    const tc_vmd_attribute *a = &model->head.attributes[i];
    double normal[3];
    if (a->type != TC_VMD_NORMAL) {
      cJSON_AddNumberToObject(json, a->name, tc_vmd_number(a, record));
      continue;
    }
    tc_vmd_normal(a, record, normal);
    cJSON_AddItemToObject(json, a->name, cJSON_CreateDoubleArray(normal, 3));
  }
  return json;
}

/* Picks the voxel in mode splat. */
static cJSON *voxel_json(const probe *p) {
  tc_splat_hit hit;
  const tc_volume *labels = p->scene.labels.volume[0] ? p->labels : NULL;
  if (!tc_splat_pick(p->volume, labels, &p->scene, (double[]){p->x + 0.5, p->y + 0.5},
                     &hit))
    return pick_json(NULL);
  const tc_reference_sample sample = {.position = {hit.position[0], hit.position[1], hit.position[2]},
                                      .distance_mm = hit.distance_mm,
                                      .value = hit.value};
  cJSON *json = pick_json(&sample);
  cJSON_AddItemToObject(json, "voxel", cJSON_CreateIntArray(hit.voxel, 3));
  if (labels)
    cJSON_AddNumberToObject(json, "label", hit.value);
  else if (tc_volume_sparse(p->volume))
    cJSON_AddItemToObject(json, "attributes", attributes_json(tc_volume_model(p->volume), hit.voxel));
  return json;
}

static cJSON *slice_json(const probe *p) {
  tc_slice_hit hit;
  if (!tc_slice_pick(p->volume, &p->scene, (double[]){p->x + 0.5, p->y + 0.5}, &hit)) return pick_json(NULL);
  const tc_reference_sample sample = {.position = {hit.position[0], hit.position[1], hit.position[2]},
                                      .distance_mm = hit.depth_mm,
                                      .value = hit.value};
  return pick_json(&sample);
}

static void run_pick(tcs_work *work) {
  probe *p = (probe *)work;
  if (p->scene.mode != TC_MODE_MESH) tc_scene_set_surfaces(&p->scene, NULL, 0); /* they were picked before */
  if (p->scene.mode == TC_MODE_SPLAT || p->scene.mode == TC_MODE_MPR) { /* which have no reference integrator */
    work->text = tcs_json_text(p->scene.mode == TC_MODE_MPR ? slice_json(p) : voxel_json(p));
    return;
  }
  tc_reference_sample *samples = NULL;
  size_t count = 0;
  tc_reference *r = trace(p, &samples, &count);
  if (!r) return;
  tc_mode mode = p->scene.mode;
  bool projection = mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE;
  bool is_surface = mode == TC_MODE_ISOSURFACE || mode == TC_MODE_MESH; /* the field's isosurface, however drawn */
  tc_reference_sample surface;
  const tc_reference_sample *hit = projection   ? shown(mode, samples, count)
                                   : is_surface ? surface_of(p, r, &surface)
                                                : first_visible(samples, count);
  const bool in_front = p->surface && !(hit && hit->distance_mm < p->surface_mm);
  work->text = tcs_json_text(in_front ? g_steal_pointer(&p->surface) : pick_json(hit));
  g_free(samples);
  tc_reference_free(r);
}

void tcs_get_ray(tcs_request *request) {
  tcs_session *session = tcs_session_of(request);
  if (session) start_probe(request, session, run_ray, NULL, 0);
}

/* Whether drawn surfaces must be picked first: the reference does not know surface lists and label surfaces. */
static bool asks_surfaces(const tc_scene *scene) {
  const bool within = scene->mesh.with_volume && (scene->mode == TC_MODE_DVR || scene->mode == TC_MODE_MIP);
  return (within && scene->mesh.n_surfaces) ||
         (scene->mode == TC_MODE_MESH && (scene->mesh.n_surfaces || scene->labels.volume[0]));
}

void tcs_pick_within(tcs_request *request, cJSON *surface, double distance_mm) {
  tcs_session *session = tcs_session_of(request);
  if (session)
    start_probe(request, session, run_pick, surface, distance_mm);
  else
    cJSON_Delete(surface);
}

void tcs_get_pick(tcs_request *request) {
  tcs_session *session = tcs_session_of(request);
  tcs_pixel at;
  if (!session) return;
  if (!asks_surfaces(&session->scene))
    start_probe(request, session, run_pick, NULL, 0);
  else if (read_pixel(request, session, &at))
    tcs_pick_surface(request, session, &at);
}
