/* All sessions: find, create, end, expire. I/O thread only. */
#ifndef TCS_SESSION_SESSIONS_H
#define TCS_SESSION_SESSIONS_H

#include "server/session/session.h"

tcs_sessions *tcs_sessions_new(tcs_server *server);
void tcs_sessions_free(tcs_sessions *sessions);
tcs_session *tcs_sessions_find(tcs_sessions *sessions, const char *id);
int tcs_sessions_count(const tcs_sessions *sessions);
/* Calls `each` for every session, oldest first. */
void tcs_sessions_each(tcs_sessions *sessions, void (*each)(tcs_session *session, void *user), void *user);

/* Creates a session on a resident volume, with its default scene and `patch` (may be NULL). TC_ERROR_BUSY at the limit
 * on sessions, or for a peer without one at twice that limit; else the errors of a scene. peer: charged for its render
 * time (schedule/fair.h). */
tcs_session *tcs_sessions_create(tcs_sessions *sessions, tcs_entry *entry, const cJSON *patch, const tcp_lists *lists,
                                 const char *peer, GError **error);
void tcs_session_end(tcs_session *session);
/* Ends every session that uses a volume, also as labels. */
void tcs_sessions_end_of(tcs_sessions *sessions, const tcs_entry *entry);

/* Ends the sessions of owners who have no token with the role edit any more; their share links end too. */
void tcs_sessions_end_orphans(tcs_sessions *sessions);

/* Microseconds until a session comes to rest or may be retried; -1 = none. */
int64_t tcs_sessions_next_us(const tcs_sessions *sessions, int64_t now_us);
/* Requests final pictures for sessions that came to rest. */
void tcs_sessions_wake(tcs_sessions *sessions, int64_t now_us);
/* Applies the patches of this turn. */
void tcs_sessions_settle(tcs_sessions *sessions);
/* Once a second: ends sessions unused for the configured time. */
void tcs_sessions_expire(tcs_sessions *sessions, int64_t now_us);

#endif
