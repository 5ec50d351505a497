#include "server/session/change.h"

#include <string.h>

#include "server/observe/metrics.h"
#include "server/session/measure.h"
#include "server/session/quality_control.h"
#include "server/session/session_scene.h"

static void changed(tcs_session *session) {
  const int64_t now_us = g_get_monotonic_time();
  for (guint i = 0; i < session->views->len; i++) {
    tcs_view *view = g_ptr_array_index(session->views, i);
    if (view->watchers && view->begun_revision < session->revision) session->server->metrics->frames_superseded++;
    tcs_measure_cancel(view);
  }
  session->revision++;
  session->server->metrics->scene_changes++;
  tcs_quality_changed(session->server->quality, session);
  session->used_us = now_us;
  session->active_until_us = now_us + TCS_REST_US;
  /* The scene's size may have changed. Viewers with a size of their own keep theirs. */
  for (guint i = 0; i < session->watchers->len; i++) tcs_watcher_seat(g_ptr_array_index(session->watchers, i));
  /* A refinement of the old scene would delay the first frame of the new one. */
  if (session->job && session->job->final) tcs_job_cancel(session->job);
  tcs_session_wake(session);
}

/* Applies a patch to `from` and stores the result in *scene (a valid scene), which is unchanged on failure. */
static bool lay_on(tcs_session *session, tc_scene *scene, const tc_scene *from, const cJSON *patch,
                   const tcp_lists *lists, GError **error) {
  tc_volume *labels;
  tc_scene next;
  tc_scene_copy(&next, from);
  if (!tcs_scene_patch(&next, &session->defaults, session->entry, patch, lists, error) ||
      !tcs_scene_check(session->server, session->entry->volume, &next, (tcs_scene_change){scene, patch}, &labels, error)) {
    tc_scene_clear(&next);
    return false;
  }
  tc_scene_clear(scene);
  *scene = next; /* moves the heap members */
  session->server->metrics->patches++;
  return true;
}

bool tcs_session_draft(tcs_watcher *watcher, uint64_t seq, const cJSON *patch, GError **error) {
  tcs_session *session = watcher->session;
  if (!session->drafted) tc_scene_copy(&session->draft, &session->scene);
  if (!lay_on(session, &session->draft, &session->draft, patch, NULL, error)) {
    if (!session->drafted) tc_scene_clear(&session->draft);
    return false;
  }
  session->drafted = true;
  watcher->drafted_seq = MAX(watcher->drafted_seq, seq);
  return true;
}

/* A change by a single author is new to the others only; they learn of it from the header of their next picture. */
static void count_for_others(tcs_session *session) {
  guint authors = 0;
  for (guint i = 0; i < session->watchers->len; i++)
    authors += ((tcs_watcher *)g_ptr_array_index(session->watchers, i))->drafted_seq > 0;
  for (guint i = 0; i < session->watchers->len; i++) {
    tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    if (authors != 1 || !watcher->drafted_seq) watcher->others++;
  }
}

void tcs_session_settle(tcs_session *session) {
  if (!session->drafted) return;
  count_for_others(session);
  session->drafted = false;
  tc_scene_clear(&session->scene);
  session->scene = session->draft;
  memset(&session->draft, 0, sizeof session->draft);
  for (guint i = 0; i < session->watchers->len; i++) {
    tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    watcher->seq = MAX(watcher->seq, watcher->drafted_seq);
    watcher->drafted_seq = 0;
  }
  tcs_session_pin(session);
  changed(session);
}

bool tcs_session_patch(tcs_session *session, const cJSON *patch, const tcp_lists *lists, bool whole, GError **error) {
  tcs_session_settle(session);
  if (!lay_on(session, &session->scene, whole ? &session->defaults : &session->scene, patch, lists, error))
    return false;
  count_for_others(session);
  tcs_session_pin(session);
  changed(session);
  return true;
}

bool tcs_session_show(tcs_session *session, tcs_entry *entry, GError **error) {
  tc_volume *labels;
  tcs_session_settle(session);
  if (entry == session->entry) return true;
  if (!tcs_scene_check(session->server, entry->volume, &session->scene, (tcs_scene_change){NULL, NULL}, &labels, error)) return false;
  tcs_session_unpin(session);
  session->entry->users--;
  session->entry = entry;
  entry->users++;
  tcs_session_pin(session);
  tc_scene_clear(&session->defaults);
  tc_scene_copy(&session->defaults, &entry->defaults);
  changed(session);
  return true;
}
