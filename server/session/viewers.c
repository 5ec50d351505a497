#include "server/session/viewers.h"

#include <inttypes.h>

#include "server/config/config.h"
#include "server/session/change.h"
#include "server/session/deliver.h"
#include "server/session/quality_control.h"
#include "server/session/session_scene.h"

void tcs_session_join(tcs_session *session, tcs_watcher *watcher, unsigned window) {
  static uint64_t last;
  watcher->session = session;
  watcher->id = ++last;
  watcher->seq = watcher->drafted_seq = watcher->others = watcher->shown_revision = 0;
  watcher->shown_final = false;
  tcs_credit_init(&watcher->credit, window);
  tcs_watcher_seat(watcher);
  session->used_us = g_get_monotonic_time();
  g_ptr_array_add(session->watchers, watcher);
  tcs_watcher_pump(watcher);
}

void tcs_session_leave(tcs_watcher *watcher) {
  tcs_session *session = watcher->session;
  if (!session) return;
  watcher->session = NULL;
  g_ptr_array_remove(session->watchers, watcher);
  tcs_session_unseat(session, g_steal_pointer(&watcher->view));
  session->used_us = g_get_monotonic_time();
  if (session->watchers->len > 0) return;
  if (session->job) tcs_job_cancel(session->job);
  tcs_client_want(session->client, TCS_CLASS_NONE);
  if (session->server->quality) tcs_quality_changed(session->server->quality, session);
}

void tcs_watcher_pump(tcs_watcher *watcher) {
  tcs_session *session = watcher->session;
  if (!session) return;
  /* An outdated picture is sent only when it is finished; here a newer one is already being made. */
  const tcs_picture *latest = watcher->view->latest;
  if (latest && latest->revision == session->revision) tcs_session_deliver_to(session, watcher, g_get_monotonic_time());
  tcs_session_wake(session);
}

bool tcs_watcher_patch(tcs_watcher *watcher, uint64_t seq, const cJSON *patch, GError **error) {
  return tcs_session_draft(watcher, seq, patch, error);
}

bool tcs_watcher_ack(tcs_watcher *watcher, uint64_t frame, GError **error) {
  if (!tcs_credit_ack(&watcher->credit, frame, g_get_monotonic_time())) {
    tc_set_error(error, TC_ERROR_INVALID, "/frame", "frame %" PRIu64 " was not sent; the last one was %" PRIu64, frame,
                 watcher->credit.sent);
    return false;
  }
  tcs_watcher_pump(watcher);
  return true;
}

void tcs_watcher_pointer(tcs_watcher *watcher, bool down) {
  tcs_session *session = watcher->session;
  session->used_us = g_get_monotonic_time();
  session->active_until_us = down ? session->used_us + TCS_REST_US : 0;
  tcs_session_wake(session);
}

bool tcs_watcher_size(tcs_watcher *watcher, int64_t width, int64_t height, GError **error) {
  if (!tcs_image_check(&watcher->session->server->config->limits, "", width, height, error)) return false;
  watcher->width = (int)width;
  watcher->height = (int)height;
  tcs_watcher_seat(watcher);
  tcs_watcher_pump(watcher);
  return true;
}
