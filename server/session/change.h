/* Changes of a session's scene. I/O thread only. */
#ifndef TCS_SESSION_CHANGE_H
#define TCS_SESSION_CHANGE_H

#include "server/session/session.h"

/* Applies a merge patch to the draft of the scene, as patch number `seq` of the viewer. Each patch is validated in
 * order of arrival; the consequences of all patches of a turn follow once, in tcs_session_settle(). On failure the
 * draft is unchanged. */
bool tcs_session_draft(tcs_watcher *watcher, uint64_t seq, const cJSON *patch, GError **error);
/* Makes the draft, if any, the scene. Called once a turn, before the scene is read. */
void tcs_session_settle(tcs_session *session);

/* Applies a merge patch to the scene, or with `whole` to the defaults. Advances the revision, cancels a refinement of
 * the old scene and wakes the viewers. On failure the scene is unchanged. lists: those of the patch, or NULL. */
bool tcs_session_patch(tcs_session *session, const cJSON *patch, const tcp_lists *lists, bool whole, GError **error);

/* Switches to another resident volume (such as the next one of a series) and keeps the scene. On failure nothing
 * changes. */
bool tcs_session_show(tcs_session *session, tcs_entry *entry, GError **error);

#endif
