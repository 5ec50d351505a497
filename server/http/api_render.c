/* Single pictures: POST /v1/render, and a session's frame, plan and thumbnail. The request is deferred while its job
 * runs. */
#include <limits.h>
#include <math.h>
#include <string.h>

#include "server/access/audit.h"
#include "server/encode/encode.h"
#include "server/http/work.h"
#include "server/session/measure.h"
#include "server/session/quality_control.h"
#include "server/session/session_scene.h"
#include "server/session/sessions.h"

static void leave_job(tcs_request *request) {
  tcs_job *job = request->owner;
  job->user = NULL;
  tcs_job_cancel(job);
}

/* session: the owner of the frame or plan, or NULL. */
static void submit(tcs_request *request, tcs_job *job, const tcs_session *session, void (*finished)(tcs_job *job)) {
  GError *error = NULL;
  job->finished = finished;
  job->user = request;
  job->peer = tcs_peer_name(request);
  if (!tcs_job_draws_nothing(job) && tcs_quality_prepare(request->server->quality, job)) {
    tcs_defer(request, leave_job, job);
    return;
  }
  tcs_quality_resolve(request->server->quality, job, session, false);
  if (tcs_scheduler_submit(request->server->scheduler, job, &error)) {
    tcs_defer(request, leave_job, job);
    return;
  }
  tcs_reply_error(request, error);
  g_clear_error(&error);
  tcs_job_free(job);
}

static void finished_picture(tcs_job *job) {
  tcs_request *request = job->user;
  if (!request) return;
  if (job->error) {
    tcs_reply_error(request, job->error);
    return;
  }
  char timing[200], size[32];
  g_snprintf(timing, sizeof timing, "queue;dur=%.2f, tables;dur=%.2f, skip;dur=%.2f, render;dur=%.2f, encode;dur=%.2f",
             job->queue_ms, job->stats.tables_ms, job->stats.skip_ms, job->stats.render_ms, job->encode_ms);
  g_snprintf(size, sizeof size, "%dx%d", job->out_width, job->out_height);
  tcs_reply_bytes(request, 200, tcs_encode_content_type(job->scene.image.format), g_bytes_ref(job->image));
  tcs_reply_header(request, "Server-Timing", timing);
  tcs_reply_header(request, "Tomocast-Size", size);
  if (job->bridged) {
    g_snprintf(size, sizeof size, "%d", job->bridged);
    tcs_reply_header(request, "Tomocast-Bridged", size);
  }
  tcs_session *session = job->revision ? tcs_sessions_find(request->server->sessions, request->params[0]) : NULL;
  if (session) tcs_session_still(session, job);
}

/* Checks the scene as it will be rendered, then queues it. session: the owner, or NULL; only sessions have a meter. */
static void render(tcs_request *request, const tcs_entry *entry, const tc_scene *scene, const tcs_session *session) {
  GError *error = NULL;
  tc_volume *labels;
  if (!tcs_scene_check(request->server, entry->volume, scene, (tcs_scene_change){session ? &session->scene : NULL, NULL}, &labels,
                       &error)) {
    tcs_reply_error_in(request, error, session ? "" : "/scene");
    g_clear_error(&error);
    return;
  }
  tcs_job *job = tcs_job_new(request->server, tcs_entry_shown(entry, scene), scene);
  job->bridged = tc_volume_provenance(entry->volume)->bridged;
  if (session) {
    job->revision = session->revision;
    job->final = true;
    job->meter_pixels = session->watchers->len ? 0 : tcs_meter_pixels(job);
  }
  if (labels) job->labels = tc_volume_ref(labels);
  job->meshes = tcs_scene_meshes(job->server, scene);
  submit(request, job, NULL, finished_picture);
}

/* name NULL: keeps *format. */
static bool read_format(tcs_request *request, const char *name, tc_image_format *format) {
  if (!name) return true;
  if (strcmp(name, "jpeg") == 0 || strcmp(name, "jpg") == 0)
    *format = TC_FORMAT_JPEG;
  else if (strcmp(name, "png") == 0)
    *format = TC_FORMAT_PNG;
  else {
    tcs_reply_problem(request, 422, "invalid", "Invalid value", "format: give \"jpeg\" or \"png\"");
    return false;
  }
  return true;
}

static bool set_quality(tcs_request *request, const cJSON *item, tc_scene *scene) {
  if (!item) return true;
  if (!cJSON_IsNumber(item) || item->valuedouble < 1 || item->valuedouble > 100 ||
      item->valuedouble != item->valueint) {
    tcs_reply_problem(request, 422, "invalid", "Invalid value", "quality: give a whole number from 1 to 100");
    return false;
  }
  scene->image.quality = item->valueint;
  return true;
}

/* The object `name` of `parent`, created if absent or null; NULL if the member is not an object. */
static cJSON *object_in(cJSON *parent, const char *name) {
  cJSON *item = cJSON_GetObjectItemCaseSensitive(parent, name);
  if (item && !cJSON_IsNull(item)) return cJSON_IsObject(item) ? item : NULL;
  cJSON_DeleteItemFromObjectCaseSensitive(parent, name);
  return cJSON_AddObjectToObject(parent, name);
}

/* Sets the format in the scene before the scene is parsed, since "transparent" depends on it. A scene or image that is
 * not an object is left for the parser to refuse. */
static void format_into_scene(cJSON *body, tc_image_format format) {
  cJSON *scene = object_in(body, "scene");
  cJSON *image = scene ? object_in(scene, "image") : NULL;
  if (!image) return;
  cJSON_DeleteItemFromObjectCaseSensitive(image, "format");
  cJSON_AddStringToObject(image, "format", format == TC_FORMAT_PNG ? "png" : "jpeg");
}

static void post_render(tcs_request *request, cJSON *body, const tcp_lists *lists) {
  static const char *const names[] = {"volume", "scene", "format", "quality", NULL};
  const char *volume, *format;
  if (!tcs_members_known(request, body, names) || !tcs_member_string(request, body, "volume", true, &volume) ||
      !tcs_member_string(request, body, "format", false, &format))
    return;
  const tcs_entry *entry = tcs_resident(request, volume, "/volume");
  if (!entry) return;
  tcs_audit(request->server->access, &request->caller, "render", NULL, entry->id);
  tc_image_format chosen = TC_FORMAT_JPEG;
  if (!read_format(request, format, &chosen)) return;
  if (format) format_into_scene(body, chosen);
  GError *error = NULL;
  tc_scene scene;
  if (!tcs_scene_make(request->server, entry, cJSON_GetObjectItemCaseSensitive(body, "scene"), lists, &scene, &error)) {
    tcs_reply_error_in(request, error, "/scene");
    g_clear_error(&error);
    return;
  }
  if (set_quality(request, cJSON_GetObjectItemCaseSensitive(body, "quality"), &scene))
    render(request, entry, &scene, NULL);
  tc_scene_clear(&scene);
}

void tcs_post_render(tcs_request *request) { tcs_read_body(request, "scene", post_render); }

void tcs_get_frame(tcs_request *request) {
  const tcs_session *session = tcs_session_of(request);
  if (!session) return;
  tc_scene scene;
  tc_scene_copy(&scene, &session->scene);
  if (read_format(request, tcs_query(request, "format"), &scene.image.format) &&
      tcs_query_int(request, "quality", 1, 100, &scene.image.quality) &&
      tcs_query_int(request, "width", 1, INT_MAX, &scene.image.width) && /* limits are checked with the scene */
      tcs_query_int(request, "height", 1, INT_MAX, &scene.image.height))
    render(request, session->entry, &scene, session);
  tc_scene_clear(&scene);
}

/* --- thumbnails ------------------------------------------------------------------------------------- */

#define THUMBNAIL_SIDE 128
#define THUMBNAIL_QUALITY 80

static void reply_thumbnail(tcs_request *request, GBytes *image) {
  tcs_reply_bytes(request, 200, tcs_encode_content_type(TC_FORMAT_JPEG), g_bytes_ref(image));
}

/* The volume may have been removed meanwhile, and its id reused. */
static void finished_thumbnail(tcs_job *job) {
  tcs_request *request = job->user;
  tcs_entry *entry = request ? tcs_catalogue_find(job->server->catalogue, TCS_KIND_VOLUME, request->params[0]) : NULL;
  if (!request) return;
  if (job->error) {
    tcs_reply_error(request, job->error);
    return;
  }
  const bool its = entry && (entry->volume == job->volume || entry->body == job->volume);
  if (its && !entry->thumbnail) entry->thumbnail = g_bytes_ref(job->image);
  reply_thumbnail(request, job->image);
}

/* Renders the default scene on first request and caches the picture with the volume. Does not count as a use of the
 * volume. */
void tcs_get_thumbnail(tcs_request *request) {
  const char *id = request->params[0];
  tcs_entry *entry = tcs_entry_visible(request, TCS_KIND_VOLUME, id)
                         ? tcs_catalogue_find(request->server->catalogue, TCS_KIND_VOLUME, id)
                         : NULL;
  if (entry && entry->thumbnail) {
    reply_thumbnail(request, entry->thumbnail);
    return;
  }
  if (!(entry = tcs_resident(request, id, NULL))) return;
  tc_scene scene;
  tc_scene_copy(&scene, &entry->defaults);
  scene.image.width = scene.image.height = THUMBNAIL_SIDE;
  scene.image.quality = THUMBNAIL_QUALITY;
  submit(request, tcs_job_new(request->server, tcs_entry_shown(entry, &scene), &scene), NULL, finished_thumbnail);
  tc_scene_clear(&scene);
}

/* --- the plan -------------------------------------------------------------------------------------- */

/* Estimated cost of the object in each mode that can draw it. */
static cJSON *object_json(const tc_object_cost *cost) {
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "cheapest", tc_mode_names[tc_object_mode_of(cost->cheapest)]);
  cJSON *ms = cJSON_AddObjectToObject(json, "expectedMs");
  for (int i = 0; i < TC_OBJECT_MODES; i++)
    cJSON_AddNumberToObject(ms, tc_mode_names[tc_object_mode_of((tc_object_mode)i)], cost->ms[i]);
  return json;
}

static cJSON *write_plan(const tcs_job *job) {
  const tc_explanation *plan = &job->plan;
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "kernel", plan->kernel);
  cJSON_AddNumberToObject(json, "width", plan->width);
  cJSON_AddNumberToObject(json, "height", plan->height);
  cJSON_AddNumberToObject(json, "stepMm", plan->step_mm);
  cJSON_AddNumberToObject(json, "tableSize", plan->table_size);
  const double range[2] = {plan->table_lo, plan->table_hi};
  cJSON_AddItemToObject(json, "tableRange", cJSON_CreateDoubleArray(range, 2));
  cJSON *quality = tcs_quality_json(job);
  if (quality) cJSON_AddItemToObject(json, "quality", quality);
  if (plan->has_object) cJSON_AddItemToObject(json, "object", object_json(&plan->object));
  cJSON *stages = cJSON_AddArrayToObject(json, "stages");
  for (int i = 0; i < TC_STAGE_COUNT; i++) {
    const tc_explained_stage *stage = &plan->stages[i];
    cJSON *item = cJSON_CreateObject();
    cJSON_AddStringToObject(item, "name", tc_stage_name((tc_stage)i));
    cJSON_AddBoolToObject(item, "included", stage->included);
    cJSON_AddStringToObject(item, "reason", stage->reason);
    cJSON_AddNumberToObject(item, "ms", stage->ms);
    cJSON_AddNumberToObject(item, "bytes", (double)stage->bytes);
    cJSON_AddItemToArray(stages, item);
  }
  return json;
}

static void finished_plan(tcs_job *job) {
  tcs_request *request = job->user;
  if (!request) return;
  if (job->error)
    tcs_reply_error(request, job->error);
  else
    tcs_reply_json(request, 200, write_plan(job));
}

void tcs_get_plan(tcs_request *request) {
  const tcs_session *session = tcs_session_of(request);
  if (!session) return;
  tcs_job *job = tcs_job_new(request->server, tcs_entry_shown(session->entry, &session->scene), &session->scene);
  if (session->labels) job->labels = tc_volume_ref(tcs_session_labels(session));
  job->plan_only = true;
  submit(request, job, session, finished_plan);
}

/* --- the pick of mode mesh --------------------------------------------------------------------------- */

static cJSON *number_or_null(double value) { return isnan(value) ? cJSON_CreateNull() : cJSON_CreateNumber(value); }

static cJSON *write_pick(const tcs_job *job) {
  const tc_pick *p = &job->pick;
  cJSON *json = cJSON_CreateObject();
  cJSON_AddItemToObject(json, "position", p->found ? cJSON_CreateDoubleArray(p->position, 3) : cJSON_CreateNull());
  cJSON_AddItemToObject(json, "value", number_or_null(p->found ? p->value : NAN));
  cJSON_AddItemToObject(json, "depth", number_or_null(p->found ? p->distance_mm : NAN));
  if (p->found && p->surface >= 0) cJSON_AddNumberToObject(json, "surface", p->surface);
  if (p->found && p->label) cJSON_AddNumberToObject(json, "label", p->label);
  return json;
}

static void finished_pick(tcs_job *job) {
  tcs_request *request = job->user;
  if (!request) return;
  if (job->error)
    tcs_reply_error(request, job->error);
  else if (job->scene.mode != TC_MODE_MESH)
    tcs_pick_within(request, job->pick.found ? write_pick(job) : NULL, job->pick.distance_mm);
  else
    tcs_reply_json(request, 200, write_pick(job));
}

void tcs_pick_surface(tcs_request *request, const tcs_session *session, const tcs_pixel *at) {
  tcs_job *job = tcs_job_new(request->server, tcs_entry_shown(session->entry, &session->scene), &session->scene);
  if (session->labels) job->labels = tc_volume_ref(tcs_session_labels(session));
  job->meshes = tcs_scene_meshes(session->server, &job->scene);
  job->width = at->width, job->height = at->height;
  job->pick_only = true;
  job->pick.at[0] = at->x + 0.5, job->pick.at[1] = at->y + 0.5;
  submit(request, job, session, finished_pick);
}
