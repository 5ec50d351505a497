#include "server/session/view.h"

#include "server/session/measure.h"

tcs_ladder *tcs_view_ladder(tcs_view *view, tc_mode mode, double ms_per_sample) {
  tcs_ladder *ladder = &view->ladders[mode];
  if (mode != TC_MODE_MPR) tcs_ladder_expect(ladder, ms_per_sample);
  return ladder;
}

tcs_view *tcs_view_new(tcs_session *session, int width, int height) {
  tcs_view *view = g_new0(tcs_view, 1);
  view->width = width;
  view->height = height;
  g_ptr_array_add(session->views, view);
  return view;
}

tcs_view *tcs_session_own_view(const tcs_session *session) { return g_ptr_array_index(session->views, 0); }

/* Cancels the view's jobs and frees it. */
static void free_view(tcs_session *session, tcs_view *view) {
  tcs_measure_cancel(view);
  for (guint i = session->jobs->len; i-- > 0;) {
    tcs_job *job = g_ptr_array_index(session->jobs, i);
    if (job->part != view) continue;
    job->part = NULL;
    tcs_job_cancel(job);
  }
  tcs_picture_unref(view->latest);
  g_ptr_array_remove(session->views, view);
  g_free(view);
}

static tcs_view *view_of(tcs_session *session, int width, int height) {
  const bool own = !width || (width == session->scene.image.width && height == session->scene.image.height);
  if (own) return tcs_session_own_view(session);
  for (guint i = 1; i < session->views->len; i++) {
    tcs_view *view = g_ptr_array_index(session->views, i);
    if (view->width == width && view->height == height) return view;
  }
  return session->views->len > TCS_MOST_SIZES ? tcs_session_own_view(session) : tcs_view_new(session, width, height);
}

void tcs_session_unseat(tcs_session *session, tcs_view *view) {
  if (--view->watchers > 0) return;
  if (view != tcs_session_own_view(session))
    free_view(session, view);
  else if (session->job && session->job->part == view)
    tcs_job_cancel(session->job);
}

void tcs_watcher_seat(tcs_watcher *watcher) {
  tcs_view *old = watcher->view, *view = view_of(watcher->session, watcher->width, watcher->height);
  if (view == old) return;
  view->watchers++;
  watcher->view = view;
  watcher->resized = watcher->shown_revision > 0;
  if (old) tcs_session_unseat(watcher->session, old);
}

void tcs_session_free_views(tcs_session *session) {
  while (session->views->len) free_view(session, g_ptr_array_index(session->views, session->views->len - 1));
  g_ptr_array_unref(session->views);
}

tcs_picture *tcs_session_latest(const tcs_session *session) {
  tcs_picture *latest = NULL;
  for (guint i = 0; i < session->views->len; i++) {
    const tcs_view *view = g_ptr_array_index(session->views, i);
    if (view->latest && (!latest || view->latest->revision > latest->revision)) latest = view->latest;
  }
  return latest;
}

bool tcs_session_settled(const tcs_session *session) {
  bool settled = session->watchers->len > 0;
  for (guint i = 0; i < session->views->len; i++) {
    const tcs_view *view = g_ptr_array_index(session->views, i);
    if (view->watchers) settled = settled && view->begun_final && view->begun_revision == session->revision;
  }
  return settled;
}
