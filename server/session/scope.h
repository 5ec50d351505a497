/* What a caller may do to a session's scene. I/O thread only. */
#ifndef TCS_SESSION_SCOPE_H
#define TCS_SESSION_SCOPE_H

#include <cjson/cJSON.h>

#include "server/access/role.h"
#include "server/session/session.h"

/* NULL, or why not, in words: one who looks changes nothing, and one who was given this session brings no other volume
 * into it as labels. */
const char *tcs_patch_forbidden(const tcs_caller *caller, const tcs_session *session, const cJSON *patch);

/* NULL, or why a caller may not have the session show another volume; NULL: one that there is not. */
const char *tcs_show_forbidden(const tcs_caller *caller, const tcs_session *session, const tcs_entry *entry);

#endif
