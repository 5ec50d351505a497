/* Questions about one pixel: the verbose ray and the pick. Both ask the reference integrator, off the render thread. */
#include <string.h>

#include "renderer/reference/reference.h"

#include "server/http/http.h"
#include "server/session/ray_json.h"
#include "server/loop/worker.h"
#include "server/session/session.h"

/* A ray shows something once this much of what lies behind it is hidden: thinner haze is looked through. */
#define VISIBLE_OPACITY 0.05

typedef struct probe {
  tcs_task task;
  tcs_request *request; /* NULL: the client has gone */
  tc_volume *volume, *labels; /* labels: or NULL */
  tc_scene scene;
  int x, y;
  cJSON *json;
  GError *error;
} probe;

static void leave_probe(tcs_request *request) { ((probe *)request->owner)->request = NULL; }

static void done_probe(tcs_task *task) {
  probe *p = (probe *)task;
  if (p->request && p->json)
    tcs_reply_json(p->request, 200, g_steal_pointer(&p->json));
  else if (p->request)
    tcs_reply_error(p->request, p->error);
  cJSON_Delete(p->json);
  g_clear_error(&p->error);
  tc_scene_clear(&p->scene);
  tc_volume_unref(p->volume);
  tc_volume_unref(p->labels);
  g_free(p);
}

static void start_probe(tcs_request *request, void (*run)(tcs_task *task)) {
  tcs_session *session = tcs_session_of(request);
  if (!session) return;
  const tc_scene *scene = &session->scene;
  int x = -1, y = -1;
  if (!tcs_query(request, "x") || !tcs_query(request, "y")) {
    tcs_reply_problem(request, 422, "invalid", "Invalid value",
                      "query x and y: give a pixel, 0 at the left and at the top");
    return;
  }
  if (!tcs_query_int(request, "x", 0, scene->image.width - 1, &x) ||
      !tcs_query_int(request, "y", 0, scene->image.height - 1, &y))
    return;
  probe *p = g_new0(probe, 1);
  *p = (probe){.task = {.run = run, .done = done_probe}, .request = request, .x = x, .y = y};
  p->volume = tc_volume_ref(session->entry->volume);
  if (session->labels) p->labels = tc_volume_ref(tcs_session_labels(session));
  tc_scene_copy(&p->scene, scene);
  tcs_defer(request, leave_probe, p);
  tcs_worker_submit(request->server->walk_worker, &p->task);
}

/* The ray through the pixel's centre; NULL with p->error set. */
static tc_reference *trace(probe *p, tc_reference_sample **samples, size_t *count) {
  tc_reference *r = tc_reference_new_labelled(p->volume, p->labels, &p->scene, p->scene.image.width,
                                              p->scene.image.height, 0, &p->error);
  if (r) tc_reference_ray(r, p->x + 0.5, p->y + 0.5, samples, count);
  return r;
}

static void run_ray(tcs_task *task) {
  probe *p = (probe *)task;
  p->json = tcs_ray_json(p->volume, p->labels, &p->scene, p->x, p->y, &p->error);
}

/* The first piece behind which VISIBLE_OPACITY is reached; in thinner haze the first piece that shows at all. */
static const tc_reference_sample *first_visible(const tc_reference_sample *samples, size_t count) {
  const tc_reference_sample *haze = NULL;
  for (size_t i = 0; i < count; i++) {
    if (!haze && samples[i].extinction > 0) haze = &samples[i];
    if (i + 1 < count && 1 - samples[i + 1].transparency >= VISIBLE_OPACITY) return &samples[i];
  }
  return haze;
}

/* What a projection shows: the end of a piece (all are monotone) with the largest value in mip, the smallest in minip;
 * the ray's entry in average, where all of the ray counts alike. */
static const tc_reference_sample *shown(tc_mode mode, tc_reference_sample *samples, size_t count) {
  if (count == 0 || mode == TC_MODE_AVERAGE) return samples;
  double sign = mode == TC_MODE_MIP ? 1 : -1;
  size_t best = 0;
  for (size_t i = 1; i < count; i++)
    if (sign * samples[i].value > sign * samples[best].value) best = i;
  tc_reference_sample *first = samples, *last = samples + count - 1;
  if (sign * last->value_back <= sign * samples[best].value || count == 1) return samples + best;
  for (int k = 0; k < 3; k++) /* the ray's end: on by the last piece's length */
    last->position[k] +=
        (last->position[k] - first->position[k]) / (last->distance_mm - first->distance_mm) * last->length_mm;
  last->distance_mm += last->length_mm;
  last->value = last->value_back;
  return last;
}

/* The surface's first hit, as the piece that begins there. */
static const tc_reference_sample *surface_of(const probe *p, const tc_reference *r, tc_reference_sample *at) {
  tc_reference_hit hit;
  if (!tc_reference_surface(r, p->x + 0.5, p->y + 0.5, &hit)) return NULL;
  *at = (tc_reference_sample){.distance_mm = hit.distance_mm, .value = p->scene.isosurface.value};
  memcpy(at->position, hit.position, sizeof at->position);
  return at;
}

static void run_pick(tcs_task *task) {
  probe *p = (probe *)task;
  tc_reference_sample *samples = NULL;
  size_t count = 0;
  tc_reference *r = trace(p, &samples, &count);
  if (!r) return;
  tc_mode mode = p->scene.mode;
  bool projection = mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE;
  tc_reference_sample surface;
  const tc_reference_sample *hit = projection                   ? shown(mode, samples, count)
                                   : mode == TC_MODE_ISOSURFACE ? surface_of(p, r, &surface)
                                                                : first_visible(samples, count);
  p->json = cJSON_CreateObject();
  if (hit) {
    cJSON_AddItemToObject(p->json, "position", cJSON_CreateDoubleArray(hit->position, 3));
    cJSON_AddNumberToObject(p->json, "value", hit->value);
    cJSON_AddNumberToObject(p->json, "depth", hit->distance_mm);
  } else {
    cJSON_AddNullToObject(p->json, "position");
    cJSON_AddNullToObject(p->json, "value");
    cJSON_AddNullToObject(p->json, "depth");
  }
  g_free(samples);
  tc_reference_free(r);
}

void tcs_get_ray(tcs_request *request) { start_probe(request, run_ray); }
void tcs_get_pick(tcs_request *request) { start_probe(request, run_pick); }
