#include "server/session/quality_control.h"

#include <inttypes.h>
#include <string.h>

#include "server/config/config.h"
#include "server/observe/log.h"
#include "server/observe/metrics.h"
#include "server/session/deliver.h"
#include "server/session/sessions.h"

/* Limit on remembered looks. Above it all are forgotten; measuring one again takes less than a second. */
#define MOST_LOOKS 64
#define CACHE_BYTES (96u << 20)

/* One measurement, for a session (all sessions with this look profit), or for a single picture that waits for it. */
typedef struct measurement {
  tcs_task task;
  tcs_quality *quality;
  tcs_job *waiting; /* or NULL */
  char *look, *session;
  tc_volume *volume, *labels; /* owned references; no labels: NULL */
  tc_scene scene;
  tc_camera camera;
  tc_quality_model model; /* known errors and times, to start from */
  tc_quality_cost cost;
  tc_quality_view view;
  tc_interrupt own, *interrupt; /* the waiting job's, if any, else &own */
  GError *error;
} measurement;

struct tcs_quality {
  tcs_server *server;
  GHashTable *models;    /* look -> tc_quality_model */
  tc_renderer *renderer; /* used by the quality worker only */
  GPtrArray *under_way;  /* measurement */
  measurement *for_session;
};

tcs_quality *tcs_quality_new(tcs_server *server) {
  tcs_quality *q = g_new0(tcs_quality, 1);
  q->server = server;
  q->models = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, g_free);
  q->under_way = g_ptr_array_new();
  return q;
}

void tcs_quality_cancel_all(tcs_quality *q) {
  for (guint i = 0; q && i < q->under_way->len; i++)
    atomic_store(&((measurement *)g_ptr_array_index(q->under_way, i))->interrupt->cancel, true);
}

void tcs_quality_free(tcs_quality *q) {
  if (!q) return;
  tc_renderer_free(q->renderer);
  g_hash_table_destroy(q->models);
  g_ptr_array_unref(q->under_way);
  g_free(q);
}

/* ---- looks ---- */

/* Key of a look: volume, labels and the scene's JSON without the members that do not affect its error model. Shared
 * lists are represented by their digests, since writing them takes long. */
static char *look_of(const tc_volume *volume, const tc_volume *labels, const tc_scene *scene) {
  static const char *const out[] = {"camera", "errorMeter", "skipping", "splat", "mpr", "isosurface"};
  static const char *const out_of[][2] = {{"image", "format"},  {"image", "quality"},        {"image", "subsampling"},
                                          {"sampling", "step"}, {"sampling", "termination"}, {"image", "width"},
                                          {"image", "height"}};
  const size_t n_out_of = G_N_ELEMENTS(out_of) - (scene->sampling.rays_per_pixel > 1 ? 2 : 0);
  tc_scene brief = *scene; /* borrows */
  if (brief.transfer_function.shared) brief.transfer_function.count = 0;
  if (brief.labels.shared_colors) brief.labels.n_colors = 0;
  if (brief.labels.shared_visible) brief.labels.n_visible = 0;
  cJSON *json = tcp_scene_write(&brief);
  for (size_t i = 0; i < G_N_ELEMENTS(out); i++) cJSON_DeleteItemFromObjectCaseSensitive(json, out[i]);
  if (!scene->mesh.with_volume) cJSON_DeleteItemFromObjectCaseSensitive(json, "mesh");
  for (size_t i = 0; i < n_out_of; i++)
    cJSON_DeleteItemFromObjectCaseSensitive(cJSON_GetObjectItemCaseSensitive(json, out_of[i][0]), out_of[i][1]);
  char *text = cJSON_PrintUnformatted(json);
  char *hash = g_compute_checksum_for_string(G_CHECKSUM_SHA256, text, -1);
  char *look =
      g_strdup_printf("%" PRIu64 " %" PRIu64 " %s %" PRIx64 " %" PRIx64 " %" PRIx64, tc_volume_serial(volume),
                      labels ? tc_volume_serial(labels) : 0, hash, tc_shared_digest(scene->transfer_function.shared),
                      tc_shared_digest(scene->labels.shared_colors), tc_shared_digest(scene->labels.shared_visible));
  g_free(hash);
  cJSON_free(text);
  cJSON_Delete(json);
  return look;
}

static char *look_of_session(const tcs_session *session) {
  return look_of(tcs_entry_shown(session->entry, &session->scene), tcs_session_labels(session), &session->scene);
}

static const tc_quality_model *model_of(const tcs_quality *q, const char *look) {
  static const tc_quality_model none;
  const tc_quality_model *model = g_hash_table_lookup(q->models, look);
  return model ? model : &none;
}

static void add_view(tcs_quality *q, const char *look, const tc_quality_view *view) {
  tc_quality_model *model = g_hash_table_lookup(q->models, look);
  if (!model) {
    if (g_hash_table_size(q->models) >= MOST_LOOKS) g_hash_table_remove_all(q->models);
    model = g_new0(tc_quality_model, 1);
    g_hash_table_insert(q->models, g_strdup(look), model);
  }
  tc_quality_add(model, view);
}

/* ---- choosing ---- */

bool tcs_quality_lit_in_motion(const tc_scene *scene, bool moving) {
  return moving && scene->shading.model != TC_SHADING_NONE;
}

/* Cost of the session's frames, or of all frames if the session has none yet. */
static const tc_quality_cost *cost_in(const tcs_quality *q, const tcs_session *session, bool moving) {
  const tc_quality_cost *own = session ? &session->cost[tcs_quality_lit_in_motion(&session->scene, moving)] : NULL;
  return own && own->w > 0 ? own : tcs_scheduler_cost(q->server->scheduler);
}

static const tc_quality_cost *cost_of(const tcs_quality *q, const tcs_session *session) {
  return cost_in(q, session, false);
}

static double pixels_of(const tc_volume *volume, const tc_scene *scene) {
  return tc_estimate_pixels(volume, scene, scene->image.width, scene->image.height);
}

/* A bound on time chooses between two methods; the session's newest picture tells which is in use. */
static void take_method_in_use(tc_scene *s, const tcs_session *session) {
  const tcs_picture *latest = session ? tcs_session_latest(session) : NULL;
  if (!(s->quality.max_ms > 0) || !latest) return;
  const tc_classification method = latest->classification;
  if (method == TC_PREINTEGRATED || method == TC_PREINTEGRATED2) s->classification = method;
}

void tcs_quality_resolve(tcs_quality *q, tcs_job *job, const tcs_session *session, bool moving) {
  tc_scene *s = &job->scene;
  tcs_quality_used *used = &job->quality;
  const tc_quality_cost *cost = cost_in(q, session, moving);
  if (!(s->quality.max_error > 0) && !(s->quality.max_ms > 0)) return;
  used->for_time = s->quality.max_ms > 0;
  used->asked = used->for_time ? s->quality.max_ms : s->quality.max_error;
  used->views = -1;
  if (!tc_quality_refuses(s, used->reason, sizeof used->reason)) {
    char *look = look_of(job->volume, job->labels, s);
    const tc_quality_model *model = model_of(q, look);
    const tc_scene own = *s; /* borrows */
    tc_quality_choice choice;
    g_free(look);
    if (tc_quality_measures(cost, s)) used->views = model->n;
    if (model->n) take_method_in_use(s, session);
    if (moving && used->for_time) s->quality.max_ms = MIN(s->quality.max_ms, TCS_LADDER_TARGET_MS);
    tc_quality_choose(model, cost, s, pixels_of(job->volume, s), &choice);
    tc_quality_apply(&choice, s);
    if (moving && !used->for_time && choice.step < own.sampling.step) { /* never more costly than the scene's own */
      s->sampling.step = own.sampling.step;
      s->classification = own.classification;
    }
    used->expected = used->for_time ? choice.ms : choice.rms;
    used->holds = choice.holds;
    g_strlcpy(used->reason, choice.reason, sizeof used->reason);
  }
  s->quality.max_error = s->quality.max_ms = 0;
  used->step = s->sampling.step;
}

cJSON *tcs_quality_json(const tcs_job *job) {
  const tcs_quality_used *used = &job->quality;
  if (!(used->asked > 0)) return NULL;
  cJSON *json = cJSON_CreateObject();
  cJSON_AddNumberToObject(json, used->for_time ? "maxMilliseconds" : "maxError", used->asked);
  if (job->scene.mode == TC_MODE_DVR) {
    cJSON *scene = tcp_scene_write(&job->scene);
    cJSON_AddItemToObject(json, "classification", cJSON_DetachItemFromObjectCaseSensitive(scene, "classification"));
    cJSON_Delete(scene);
  }
  cJSON_AddNumberToObject(json, "step", job->scene.sampling.step);
  cJSON_AddNumberToObject(json, "termination", job->scene.sampling.termination);
  if (used->expected > 0) cJSON_AddNumberToObject(json, "expected", used->expected);
  cJSON_AddBoolToObject(json, "holds", used->holds);
  if (used->views >= 0) cJSON_AddNumberToObject(json, "views", used->views);
  cJSON_AddStringToObject(json, "reason", used->reason);
  return json;
}

/* ---- measuring ---- */

static void run(tcs_task *task) {
  measurement *m = (measurement *)task;
  tcs_quality *q = m->quality;
  if (atomic_load(&m->interrupt->cancel)) {
    tc_set_error(&m->error, TC_ERROR_CANCELLED, NULL, "cancelled");
    return;
  }
  const tc_renderer_options options = {.backend = TC_BACKEND_CPU, .threads = 1, .cache_bytes = CACHE_BYTES};
  if (!q->renderer) q->renderer = tc_renderer_new(&options, &m->error);
  const tc_quality_subject of = {m->volume, m->labels, &m->scene, &m->camera, &m->model, &m->cost, m->interrupt};
  if (q->renderer) tc_quality_measure(q->renderer, &of, &m->view, &m->error);
}

static void submit_waiting(tcs_quality *q, tcs_job *job) {
  GError *error = NULL;
  if (!job->user) { /* the client left */
    tcs_job_free(job);
    return;
  }
  tcs_quality_resolve(q, job, NULL, false);
  if (tcs_scheduler_submit(q->server->scheduler, job, &error)) return;
  job->error = error;
  job->finished(job);
  tcs_job_free(job);
}

/* Renders final pictures again for which the new model gives a better choice. */
static void refine(tcs_session *session, void *user) {
  const measurement *m = user;
  const tcs_picture *latest = tcs_session_latest(session);
  const tc_quality_cost *cost = cost_of(m->quality, session);
  if (!latest || !latest->final || latest->revision != session->revision) return;
  if (!tc_quality_measures(cost, &session->scene)) return;
  char *look = look_of_session(session);
  if (strcmp(look, m->look) == 0) {
    const tc_quality_model *model = model_of(m->quality, look);
    tc_scene scene = session->scene; /* borrows */
    tc_quality_choice choice;
    take_method_in_use(&scene, session);
    tc_quality_choose(model, cost, &scene, pixels_of(m->volume, &scene), &choice);
    if (tc_quality_betters(model, &scene, &choice, latest->classification, latest->step)) tcs_session_refine(session);
  }
  g_free(look);
}

static void done(tcs_task *task) {
  measurement *m = (measurement *)task;
  tcs_quality *q = m->quality;
  g_ptr_array_remove_fast(q->under_way, m);
  if (q->for_session == m) q->for_session = NULL;
  if (!m->error) {
    q->server->metrics->quality_measurements++;
    add_view(q, m->look, &m->view);
    tcs_sessions_each(q->server->sessions, refine, m);
  } else if (!g_error_matches(m->error, TC_ERROR, TC_ERROR_CANCELLED)) {
    tcs_log(TCS_LOG_WARN, "quality.failed", "code=%d", m->error->code);
  }
  if (m->waiting) submit_waiting(q, m->waiting);
  /* A failed measurement would fail again: not before the next final frame. */
  const bool again = !m->error || g_error_matches(m->error, TC_ERROR, TC_ERROR_CANCELLED);
  tc_volume_unref(m->volume);
  tc_volume_unref(m->labels);
  tc_scene_clear(&m->scene);
  g_clear_error(&m->error);
  g_free(m->look);
  g_free(m->session);
  g_free(m);
  if (again) tcs_quality_pump(q);
}

/* What to measure. cost: of similar frames. */
typedef struct subject {
  tc_volume *volume, *labels;
  const tc_scene *scene;
  const tc_camera *camera;
  const tc_quality_cost *cost;
} subject;

/* Takes `look`. waiting: a job to queue afterwards, or NULL. */
static measurement *begin(tcs_quality *q, tcs_job *waiting, const subject *of, char *look) {
  measurement *m = g_new0(measurement, 1);
  *m = (measurement){.task = {.run = run, .done = done}, .quality = q, .look = look, .camera = *of->camera};
  m->volume = tc_volume_ref(of->volume);
  if (of->labels) m->labels = tc_volume_ref(of->labels);
  tc_scene_copy(&m->scene, of->scene);
  m->model = *model_of(q, look);
  m->cost = *of->cost;
  tc_interrupt_init(&m->own);
  m->waiting = waiting;
  m->interrupt = waiting ? &waiting->interrupt : &m->own;
  g_ptr_array_add(q->under_way, m);
  tcs_worker_submit(q->server->quality_worker, &m->task);
  return m;
}

bool tcs_quality_prepare(tcs_quality *q, tcs_job *job) {
  const bool waits =
      job->scene.quality.max_error > 0 && tc_quality_measures(tcs_scheduler_cost(q->server->scheduler), &job->scene);
  if (!waits || (int64_t)q->under_way->len >= q->server->config->limits.queue) return false;
  tc_quality_choice choice;
  char *look = look_of(job->volume, job->labels, &job->scene);
  tc_quality_choose(model_of(q, look), tcs_scheduler_cost(q->server->scheduler), &job->scene,
                    pixels_of(job->volume, &job->scene), &choice);
  if (choice.near) {
    g_free(look);
    return false;
  }
  const subject of = {job->volume, job->labels, &job->scene, &job->scene.camera, tcs_scheduler_cost(q->server->scheduler)};
  begin(q, job, &of, look);
  return true;
}

static void measure_for(tcs_session *session, void *user) {
  tcs_quality *q = user;
  tc_camera camera;
  if (q->for_session || !tcs_session_settled(session)) return;
  if (!tc_quality_measures(cost_of(q, session), &session->scene)) return;
  char *look = look_of_session(session);
  if (!tc_quality_wants(model_of(q, look), &session->scene, &camera)) {
    g_free(look);
    return;
  }
  const subject of = {tcs_entry_shown(session->entry, &session->scene), tcs_session_labels(session), &session->scene,
                      &camera, cost_of(q, session)};
  q->for_session = begin(q, NULL, &of, look);
  q->for_session->session = g_strdup(session->id);
}

void tcs_quality_pump(tcs_quality *q) {
  if (!q->for_session && !q->server->draining && q->server->sessions)
    tcs_sessions_each(q->server->sessions, measure_for, q);
}

void tcs_quality_changed(tcs_quality *q, const tcs_session *session) {
  measurement *m = q->for_session;
  if (!m || strcmp(m->session, session->id) != 0) return;
  const bool wanted = session->watchers->len && tc_quality_measures(cost_of(q, session), &session->scene);
  char *look = wanted ? look_of_session(session) : NULL;
  if (!look || strcmp(look, m->look) != 0) atomic_store(&m->interrupt->cancel, true);
  g_free(look);
}
