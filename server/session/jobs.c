#include "server/session/jobs.h"

#include <math.h>

#include "server/observe/metrics.h"
#include "server/session/deliver.h"
#include "server/session/measure.h"
#include "server/session/quality.h"

/* Whether some viewer waits for a picture that is not under way; `final` tells which kind. */
static bool has_work(const tcs_session *session, int64_t now_us, bool *final) {
  if (session->job || session->watchers->len == 0) return false;
  *final = tcs_session_at_rest(session, now_us);
  const bool begun = session->begun_revision == session->revision && (session->begun_final || !*final);
  if (begun) return false;
  for (guint i = 0; i < session->watchers->len; i++) {
    const tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    if (tcs_watcher_wants(watcher, session->revision, *final) && tcs_window_open(&watcher->window, now_us) &&
        watcher->ops->ready(watcher))
      return true;
  }
  return false;
}

static void finished(tcs_job *job) {
  tcs_session *session = job->user;
  if (!session) return;
  g_ptr_array_remove(session->jobs, job);
  if (session->job == job) session->job = NULL;
  if (job->error) {
    const bool cancelled = g_error_matches(job->error, TC_ERROR, TC_ERROR_CANCELLED);
    if (cancelled) session->server->metrics->frames_cancelled++;
    /* What was begun did not come: the newest picture that did is the last one begun. */
    session->begun_revision = session->latest ? session->latest->revision : 0;
    session->begun_final = session->latest && session->latest->final;
    if (!cancelled) tcs_session_fail(session, job);
    return;
  }
  const double pixels = (double)job->out_width * job->out_height;
  if (!job->stats.stand_in) {
    tcs_ladder_measure(&session->ladder, pixels, job->stats.render_ms);
    tc_quality_cost_add(&session->cost, &job->scene, pixels, job->stats.render_ms);
  }
  tcs_picture_unref(session->latest);
  session->latest = tcs_picture_new(job);
  g_clear_pointer(&session->still, tcs_picture_unref);
  tcs_measure_cancel(session); /* of another picture */
  if (job->meter && job->revision == session->revision) tcs_measure_begin(session, job, session->latest);
  tcs_session_deliver(session);
  if (job->final) tcs_quality_pump(session->server->quality);
}

/* An interactive frame is smaller and coarser in its JPEG; the view is the same. */
static void make_interactive(tcs_session *session, tcs_job *job) {
  const int width = job->scene.image.width, height = job->scene.image.height;
  const tcs_quality_used *quality = &job->quality;
  const double budget = quality->for_time ? MIN(quality->asked, TCS_LADDER_TARGET_MS) : TCS_LADDER_TARGET_MS;
  const double scale = tcs_ladder_scale(&session->ladder, (double)width * height, budget);
  job->width = MAX(1, (int)lround(width * scale));
  job->height = MAX(1, (int)lround(height * scale));
  if (!job->scene.image.transparent) job->scene.image.format = TC_FORMAT_JPEG;
  job->scene.image.quality = MIN(job->scene.image.quality, TCS_INTERACTIVE_QUALITY);
  job->scene.image.subsampling = TC_SUBSAMPLING_420;
}

/* The job leaves session->job when its rendering is over: the next one may render while this one is encoded. */
static void rendered(tcs_job *job) {
  tcs_session *session = job->user;
  if (session && session->job == job) session->job = NULL;
}

static tcs_job *begin_job(tcs_session *session, bool final) {
  tcs_job *job = tcs_job_new(session->server, session->entry->volume, &session->scene);
  if (session->labels) job->labels = tc_volume_ref(tcs_session_labels(session));
  job->rendered = rendered;
  job->finished = finished;
  job->user = session;
  job->revision = session->revision;
  job->final = final;
  job->hurry = true;
  tcs_quality_resolve(session->server->quality, job, session, !final);
  if (!final) make_interactive(session, job);
  if (final) job->meter_pixels = tcs_meter_pixels(job);
  job->marks = tcs_session_marks(session);
  session->job = job;
  session->begun_revision = job->revision;
  session->begun_final = final;
  g_ptr_array_add(session->jobs, job);
  return job;
}

tcs_job *tcs_session_next_job(tcs_session *session, int64_t now_us) {
  bool final;
  return has_work(session, now_us, &final) ? begin_job(session, final) : NULL;
}
