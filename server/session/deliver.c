#include "server/session/deliver.h"

#include "server/observe/metrics.h"

#define LONG_BUILDING_US 300000 /* shorter builds are not reported */

/* Sends the newest picture to a viewer that can take it and has not seen it, even if the scene has changed since: while
 * input arrives every picture is one change behind, but newer than the last. */
void tcs_session_deliver_to(tcs_session *session, tcs_watcher *watcher, int64_t now_us) {
  const tcs_picture *picture = watcher->view->latest;
  if (!picture ||
      (!tcs_watcher_wants(watcher, picture->revision, picture->final) && !tcs_watcher_wants_error(watcher, picture)))
    return;
  if (!tcs_credit_open(&watcher->credit, now_us) || !watcher->ops->ready(watcher)) return;
  tcp_frame_header header = picture->header;
  header.frame = tcs_credit_send(&watcher->credit, now_us);
  header.seq = tcs_watcher_seq_in(watcher, picture, session->revision);
  header.others = watcher->others;
  watcher->resized = false;
  watcher->shown_revision = picture->revision;
  watcher->shown_final = picture->final;
  watcher->shown_error = tcs_picture_is_judged(picture);
  session->server->metrics->frames_sent++;
  watcher->ops->frame(watcher, picture, &header);
}

void tcs_session_deliver(tcs_session *session) {
  const int64_t now_us = g_get_monotonic_time();
  /* Backwards: a viewer whose socket fails here removes itself from the list. */
  for (guint i = session->watchers->len; i-- > 0;)
    tcs_session_deliver_to(session, g_ptr_array_index(session->watchers, i), now_us);
}

/* The viewer waits for no other picture of this revision. */
static void settle(tcs_watcher *watcher, uint64_t revision) {
  if (watcher->shown_revision > revision) return;
  watcher->shown_revision = revision;
  watcher->shown_final = true;
  watcher->resized = false;
}

tcs_building tcs_session_building(const tcs_session *session) {
  const tcs_job *job = session->job;
  const int resource = job ? atomic_load(&job->building.resource) : 0;
  if (!resource || atomic_load(&job->interrupt.cancel) || g_get_monotonic_time() - job->queued_us < LONG_BUILDING_US)
    return (tcs_building){0};
  return (tcs_building){tc_stage_name(tc_stage_of((tc_resource)(resource - 1))),
                        (double)atomic_load(&job->building.permille) / 1000};
}

void tcs_building_write(const tcs_building *building, cJSON *json) {
  cJSON_AddStringToObject(json, "stage", building->stage);
  cJSON_AddNumberToObject(json, "share", building->share);
}

void tcs_session_report(tcs_session *session) {
  const tcs_building building = tcs_session_building(session);
  if (!building.stage) return;
  cJSON *json = cJSON_CreateObject();
  cJSON_AddStringToObject(json, "type", "building");
  tcs_building_write(&building, json);
  char *text = cJSON_PrintUnformatted(json);
  /* Backwards: a viewer whose socket fails here removes itself from the list. */
  for (guint i = session->watchers->len; i-- > 0;) {
    tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    if (session->job && watcher->view == session->job->part && watcher->ops->ready(watcher))
      watcher->ops->text(watcher, text);
  }
  cJSON_free(text);
  cJSON_Delete(json);
}

void tcs_session_give_up(tcs_session *session) {
  tcs_job *job = session->job;
  if (!job || !atomic_load(&job->building.resource)) return;
  for (guint i = 0; i < session->watchers->len; i++) {
    tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    if (watcher->view == job->part) settle(watcher, job->revision);
  }
  tcs_job_cancel(job);
}

void tcs_session_fail(tcs_session *session, const tcs_job *job) {
  cJSON *problem = tcp_problem(job->error);
  /* Backwards: a viewer whose socket fails here removes itself from the list. */
  for (guint i = session->watchers->len; i-- > 0;) {
    tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    if (watcher->view != job->part) continue;
    cJSON *message = cJSON_CreateObject();
    cJSON_AddStringToObject(message, "type", "error");
    cJSON_AddNumberToObject(message, "seq", (double)watcher->seq);
    cJSON_AddItemReferenceToObject(message, "problem", problem);
    char *text = cJSON_PrintUnformatted(message);
    watcher->ops->text(watcher, text);
    cJSON_free(text);
    cJSON_Delete(message);
    settle(watcher, job->revision); /* a retry would fail again */
  }
  cJSON_Delete(problem);
}

GArray *tcs_session_marks(const tcs_session *session) {
  GArray *marks = g_array_sized_new(FALSE, FALSE, sizeof(tcs_mark), session->watchers->len);
  for (guint i = 0; i < session->watchers->len; i++) {
    const tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    const tcs_mark mark = {watcher->id, watcher->seq};
    g_array_append_val(marks, mark);
  }
  return marks;
}

void tcs_session_refine(tcs_session *session) {
  for (guint i = 0; i < session->views->len; i++) {
    tcs_view *view = g_ptr_array_index(session->views, i);
    view->begun_final = false;
    if (view->latest) view->latest->final = false; /* its header said final, but is not sent again */
  }
  for (guint i = 0; i < session->watchers->len; i++)
    ((tcs_watcher *)g_ptr_array_index(session->watchers, i))->shown_final = false;
  tcs_session_wake(session);
}
