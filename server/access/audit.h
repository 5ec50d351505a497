/* Who opened what: lines "audit.EVENT" in the log, with the name of the caller's token and its role. No patient data:
 * of a session the first digits of its random id, of a volume, whose id a client chose, a hash that is salted anew with
 * every start. I/O thread. */
#ifndef TCS_ACCESS_AUDIT_H
#define TCS_ACCESS_AUDIT_H

#include "server/access/access.h"

/* event: "session.create" ...; session and volume: ids, or NULL. */
void tcs_audit(tcs_access *access, const tcs_caller *caller, const char *event, const char *session,
               const char *volume);
/* Somebody was turned away; why: "host", "origin", "token", "role", "session". A flood of them is counted, not told. */
void tcs_audit_refused(tcs_access *access, const tcs_caller *caller, const char *why);

#endif
