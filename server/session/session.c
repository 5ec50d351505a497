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
