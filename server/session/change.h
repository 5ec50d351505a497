/* Changes of a session's scene. I/O thread only. */
#ifndef TCS_SESSION_CHANGE_H
#define TCS_SESSION_CHANGE_H

#include "server/session/session.h"

/* Merge patch onto the draft of the scene, as patch number `seq` of the viewer: each is read and checked by itself and
 * in its place, but what follows from a change follows once for all of a turn, in tcs_session_settle(). On failure the
 * draft stays. */
bool tcs_session_draft(tcs_watcher *watcher, uint64_t seq, const cJSON *patch, GError **error);
/* The draft, where there is one, becomes the scene. Called once a turn, before the scene is read. */
void tcs_session_settle(tcs_session *session);

/* Merge patch onto the scene, or onto the defaults when `whole`: counts the revision, cancels a refinement of the old
 * scene, wakes the viewers. On failure the scene stays. lists: the patch's, or NULL. */
bool tcs_session_patch(tcs_session *session, const cJSON *patch, const tcp_lists *lists, bool whole, GError **error);

/* Shows another resident volume with the scene as it is: the next volume of a series, say. On failure all stays. */
bool tcs_session_show(tcs_session *session, tcs_entry *entry, GError **error);

#endif
