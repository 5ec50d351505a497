#include "server/session/session.h"

tc_volume *tcs_session_labels(const tcs_session *session) { return session->labels ? session->labels->volume : NULL; }

static void set_labels(tcs_session *session, tcs_entry *labels) {
  if (session->labels && session->labels != session->entry) session->labels->users--;
  if (labels && labels != session->entry) labels->users++;
  session->labels = labels;
}

void tcs_session_pin(tcs_session *session) {
  const char *id = session->scene.labels.volume;
  set_labels(session, *id ? tcs_catalogue_find(session->server->catalogue, id) : NULL);
}

void tcs_session_unpin(tcs_session *session) { set_labels(session, NULL); }

double tcs_session_samples(tcs_session *session) {
  const tc_scene *scene = &session->scene;
  if (session->samples_revision != session->revision)
    session->full_samples =
        tc_estimate_samples(session->entry->volume, scene, scene->image.width, scene->image.height, NULL);
  session->samples_revision = session->revision;
  return session->full_samples;
}

static double full_ms(tcs_session *session) {
  tcs_ladder_expect(&session->ladder, tcs_scheduler_ms_per_sample(session->server->scheduler));
  return session->ladder.ms_per_sample * tcs_session_samples(session);
}

static bool has_not_seen(const tcs_session *session, const tcs_watcher *watcher) {
  return session->begun_revision != session->revision && watcher->shown_revision != session->revision;
}

/* A scene that a viewer has not seen at all is shown soon, even at rest: where its final picture takes long, by one of
 * those that are dragged. */
static bool wants_preview(tcs_session *session, const tcs_watcher *watcher) {
  const double soon_ms =
      watcher->shown_revision ? tcs_scheduler_moving_ms(session->server->scheduler) : TCS_LONG_MS;
  return has_not_seen(session, watcher) && full_ms(session) > soon_ms;
}

/* The first picture of all is waited for as a single one is. */
static tcs_class class_of(tcs_session *session, const tcs_watcher *watcher, bool rest) {
  if (!rest || wants_preview(session, watcher)) return TCS_CLASS_INTERACTIVE;
  if (!watcher->shown_revision) return TCS_CLASS_SINGLE;
  return has_not_seen(session, watcher) ? TCS_CLASS_INTERACTIVE : TCS_CLASS_REFINE;
}

bool tcs_session_wants_final(tcs_session *session, int64_t now_us) {
  bool final = tcs_session_at_rest(session, now_us);
  for (guint i = 0; final && i < session->watchers->len; i++)
    final = !wants_preview(session, g_ptr_array_index(session->watchers, i));
  return final;
}

tcs_class tcs_session_wants(tcs_session *session, int64_t now_us) {
  tcs_class wanted = TCS_CLASS_NONE;
  if (session->job || session->watchers->len == 0) return wanted;
  const bool rest = tcs_session_at_rest(session, now_us);
  if (session->begun_revision == session->revision && (session->begun_final || !rest)) return wanted;
  for (guint i = 0; i < session->watchers->len; i++) {
    const tcs_watcher *watcher = g_ptr_array_index(session->watchers, i);
    if (tcs_watcher_wants(watcher, session->revision, rest) && tcs_window_open(&watcher->window, now_us) &&
        watcher->ops->ready(watcher))
      wanted = MIN(wanted, class_of(session, watcher, rest));
  }
  return wanted;
}

void tcs_session_wake(tcs_session *session) {
  tcs_client_want(session->client, tcs_session_wants(session, g_get_monotonic_time()));
  tcs_scheduler_pump(session->server->scheduler);
}
