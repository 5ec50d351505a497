#include "server/session/jobs.h"

#include <math.h>

#include "server/config/config.h"
#include "server/observe/metrics.h"
#include "server/session/deliver.h"
#include "server/session/measure.h"
#include "server/session/quality_control.h"
#include "server/session/samples.h"
#include "server/session/session_scene.h"

/* Least length of the longer side of an interactive frame, unless the scene is smaller. */
#define LEAST_SIDE 48.0
/* Weight of the newest frame in session->build_ms. */
#define BUILD_WEIGHT 0.5
/* Least share of an interactive frame's time that is left for drawing, however long building takes. */
#define LEAST_DRAWING 0.4
/* An interactive frame that has taken this long, and will take as long again, is misjudged. */
#define LATE_MS (2 * TCS_LADDER_TARGET_MS)

static bool is_lit_better_at_rest(const tc_scene *scene) {
  return scene->shading.model != TC_SHADING_NONE && scene->shading.gradient == TC_GRADIENT_CENTRAL;
}

/* Whether frame times at rest and in motion predict each other badly: gradients differ, and every sample is lit. A
 * surface is lit only once per pixel. */
static bool differs_in_motion(const tc_scene *scene) {
  return scene->mode == TC_MODE_DVR && is_lit_better_at_rest(scene);
}

/* With two encoders a picture may finish after a newer one, or after the final one of the same scene. It must not
 * replace that one, or a viewer that joins later would never get a final picture. */
static bool overtaken(const tcs_view *view, const tcs_job *job) {
  const tcs_picture *latest = view->latest;
  if (!latest) return false;
  if (latest->revision != job->revision) return latest->revision > job->revision;
  return latest->final && !job->final;
}

static void finished(tcs_job *job) {
  tcs_session *session = job->user;
  tcs_view *view = job->part; /* NULL: its size has no viewers any more */
  if (!session) return;
  g_ptr_array_remove(session->jobs, job);
  if (session->job == job) session->job = NULL;
  if (job->error) {
    const bool cancelled = g_error_matches(job->error, TC_ERROR, TC_ERROR_CANCELLED);
    if (cancelled) session->server->metrics->frames_cancelled++;
    if (view) { /* the failed picture no longer counts as begun: back to the newest finished one */
      view->begun_revision = view->latest ? view->latest->revision : 0;
      view->begun_final = view->latest && view->latest->final;
    }
    if (!cancelled) tcs_session_fail(session, job);
    tcs_session_wake(session);
    return;
  }
  if (!job->stats.stand_in) {
    if (view && !differs_in_motion(&job->scene))
      tcs_ladder_measure(&view->ladders[job->scene.mode], job->samples, job->stats.render_ms);
    session->build_ms += BUILD_WEIGHT * (job->stats.tables_ms + job->stats.skip_ms - session->build_ms);
    const double pixels = tc_estimate_pixels(job->volume, &job->scene, job->out_width, job->out_height);
    const double slower = job->stats.render_ms / tc_quality_cost_ms(session->cost, &job->scene, pixels);
    tc_quality_pace_add(&session->pace, slower, job->moving, job->revision);
    tc_quality_cost_add(&session->cost[tcs_quality_lit_in_motion(&job->scene, job->moving)], &job->scene, pixels,
                        job->stats.render_ms);
  }
  if (!view || overtaken(view, job)) {
    tcs_session_wake(session);
    return;
  }
  tcs_picture_unref(view->latest);
  view->latest = tcs_picture_new(job);
  g_clear_pointer(&session->still, tcs_picture_unref);
  tcs_measure_cancel(view); /* of the previous picture */
  if (job->meter && job->revision == session->revision) tcs_measure_begin(session, view, job, view->latest);
  tcs_session_deliver(session);
  tcs_session_wake(session);
  if (job->final) tcs_quality_pump(session->server->quality);
}

/* In motion: lighting by cell gradients, at a fraction of the cost of central differences. */
static void light_for_motion(tc_scene *scene) {
  if (is_lit_better_at_rest(scene)) scene->shading.gradient = TC_GRADIENT_CELL;
}

static double samples_of(const tcs_job *job) {
  const int width = job->width ? job->width : job->scene.image.width;
  const int height = job->height ? job->height : job->scene.image.height;
  return tc_estimate_samples(job->volume, &job->scene, job->meshes, width, height, NULL);
}

/* Target time for drawing: while the transfer function is dragged, each frame first builds its tables. */
static double target_ms(const tcs_session *session, const tcs_job *job) {
  const double most = tcs_scheduler_moving_ms(job->server->scheduler);
  const double frame_ms = job->quality.for_time ? MIN(job->quality.asked, most) : most;
  return MAX(frame_ms - session->build_ms, frame_ms * LEAST_DRAWING);
}

/* Interactive frames are smaller, have lower JPEG quality and, if that is not enough, fewer samples. The view is the
 * same. */
static void make_interactive(tcs_session *session, tcs_view *view, tcs_job *job) {
  const int width = job->scene.image.width, height = job->scene.image.height;
  job->moving = true;
  light_for_motion(&job->scene);
  tcs_ladder *ladder =
      tcs_view_ladder(view, job->scene.mode, tcs_scheduler_ms_per_sample(session->server->scheduler));
  ladder->has_levels = job->scene.mode == TC_MODE_MESH;
  const tcs_rung rung =
      tcs_ladder_pick(ladder, samples_of(job), (double)width * height, target_ms(session, job));
  job->coarser_levels = rung.detail;
  const double scale = MAX(rung.scale, MIN(1, LEAST_SIDE / MAX(width, height)));
  job->width = MAX(1, (int)lround(width * scale));
  job->height = MAX(1, (int)lround(height * scale));
  tcs_rung_coarsen(rung.coarser, &job->scene);
  if (!job->scene.image.transparent) job->scene.image.format = TC_FORMAT_JPEG;
  job->scene.image.quality = MIN(job->scene.image.quality, TCS_INTERACTIVE_QUALITY);
  job->scene.image.subsampling = TC_SUBSAMPLING_420;
}

/* Whether to continue a paused frame. A misjudged one is cancelled for a smaller one, since this frame and the next
 * ones of its size would be late. */
static bool goes_on(tcs_job *job) {
  tcs_session *session = job->user;
  tcs_view *view = job->part;
  const double done = MAX(tc_frame_done(&job->frame), 0.02), ms = job->stats.render_ms;
  if (!session || !view) return false;
  if (job->final || job->stats.stand_in || ms < LATE_MS || ms / done - ms < LATE_MS) return true;
  tcs_ladder *ladder = &view->ladders[job->scene.mode];
  const int rung = ladder->rung;
  tc_scene full = session->scene; /* borrows the lists of the session's scene */
  tc_mesh *const *meshes = job->revision == session->revision ? job->meshes : NULL; /* only if of the same surfaces */
  light_for_motion(&full);
  tcs_ladder_measure(ladder, job->samples * done, ms);
  tcs_ladder_pick(ladder, tc_estimate_samples(job->volume, &full, meshes, view->width ? view->width : full.image.width,
                                              view->height ? view->height : full.image.height, NULL),
                  0, target_ms(session, job));
  return ladder->rung <= rung;
}

/* After rendering the job leaves session->job, so that the next job can render while this one is encoded. */
static void rendered(tcs_job *job) {
  tcs_session *session = job->user;
  if (!session || session->job != job) return;
  session->job = NULL;
  tcs_session_wake(session);
}

/* Sets the view's size, or a smaller one if that would exceed the limit on samples. */
static void make_of_size(const tcs_session *session, const tcs_view *view, tc_scene *scene, tc_mesh *const *meshes) {
  const tcs_limits *limits = &session->server->config->limits;
  const tcs_samples_limits most = {(double)limits->render_samples, (double)limits->ray_samples};
  if (!view->width) return;
  scene->image.width = view->width;
  scene->image.height = view->height;
  tcs_samples_shrink(session->entry->volume, scene, meshes, &most);
}

static tcs_job *begin_job(tcs_session *session, tcs_view *view, tcs_class class, bool final) {
  tcs_job *job = tcs_job_new(session->server, tcs_entry_shown(session->entry, &session->scene), &session->scene);
  g_strlcpy(job->shown, session->entry->id, sizeof job->shown);
  job->bridged = tc_volume_provenance(session->entry->volume)->bridged;
  if (session->labels) job->labels = tc_volume_ref(tcs_session_labels(session));
  job->meshes = tcs_scene_meshes(session->server, &job->scene);
  make_of_size(session, view, &job->scene, job->meshes);
  job->class = class;
  job->paused = goes_on;
  job->rendered = rendered;
  job->finished = finished;
  job->user = session;
  job->part = view;
  job->revision = session->revision;
  job->final = final;
  job->hurry = true;
  if (final) tc_quality_pace_follow(&session->pace, session->cost, job->revision);
  tcs_quality_resolve(session->server->quality, job, session, !final);
  if (!final) make_interactive(session, view, job);
  job->samples = samples_of(job);
  if (!final) job->thought_ms = view->ladders[job->scene.mode].ms_per_sample * job->samples + session->build_ms;
  if (final) job->meter_pixels = tcs_meter_pixels(job);
  job->marks = tcs_session_marks(session);
  session->job = job;
  view->begun_revision = job->revision;
  view->begun_final = final;
  g_ptr_array_add(session->jobs, job);
  return job;
}

tcs_job *tcs_session_next_job(void *user, tcs_class class) {
  tcs_session *session = user;
  const int64_t now_us = g_get_monotonic_time();
  tcs_view *view;
  const tcs_class wanted = tcs_session_wants(session, now_us, &view);
  if (wanted == class) return begin_job(session, view, class, tcs_session_wants_final(session, view, now_us));
  tcs_client_want(session->client, wanted);
  return NULL;
}
