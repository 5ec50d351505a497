/* Changes of a session's scene. I/O thread only. */
#ifndef TCS_SESSION_CHANGE_H
#define TCS_SESSION_CHANGE_H

#include "server/session/session.h"

/* Merge patch onto the scene, or onto the defaults when `whole`: counts the revision, cancels a refinement of the old
 * scene, wakes the viewers. On failure the scene stays. */
bool tcs_session_patch(tcs_session *session, const cJSON *patch, bool whole, GError **error);

#endif
