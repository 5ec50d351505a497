/* Permissions of a caller on a session's scene. I/O thread only. */
#ifndef TCS_SESSION_SCOPE_H
#define TCS_SESSION_SCOPE_H

#include <cjson/cJSON.h>

#include "server/access/role.h"
#include "server/session/session.h"

/* NULL, or the reason for a refusal: a viewer may change nothing, and a caller with a link to this session may not use
 * another volume as labels. */
const char *tcs_patch_forbidden(const tcs_caller *caller, const tcs_session *session, const cJSON *patch);

/* NULL, or the reason why the caller may not switch the session to another volume. entry NULL: no such volume. */
const char *tcs_show_forbidden(const tcs_caller *caller, const tcs_session *session, const tcs_entry *entry);

#endif
