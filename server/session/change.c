#include "server/session/change.h"

#include "server/observe/metrics.h"
#include "server/session/measure.h"
#include "server/session/quality.h"
#include "server/session/scene.h"

static void changed(tcs_session *session) {
  const int64_t now_us = g_get_monotonic_time();
  if (session->watchers->len && session->begun_revision < session->revision)
    session->server->metrics->frames_superseded++;
  session->revision++;
  tcs_measure_cancel(session);
  tcs_quality_changed(session->server->quality, session);
  session->used_us = now_us;
  session->active_until_us = now_us + TCS_REST_US;
  /* A refinement of the old scene would hold up the first frame of the new one. */
  if (session->job && session->job->final) tcs_job_cancel(session->job);
  tcs_session_wake(session);
}

bool tcs_session_patch(tcs_session *session, const cJSON *patch, bool whole, GError **error) {
  tc_volume *labels;
  tc_scene next;
  tc_scene_copy(&next, whole ? &session->defaults : &session->scene);
  if (!tcs_scene_patch(&next, &session->defaults, session->entry->volume, patch, error) ||
      !tcs_scene_check(session->server, session->entry->volume, &next, &session->scene, &labels, error)) {
    tc_scene_clear(&next);
    return false;
  }
  tc_scene_clear(&session->scene);
  session->scene = next; /* moves the heap members */
  tcs_session_pin(session);
  changed(session);
  return true;
}
