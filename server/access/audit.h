/* Audit trail: lines "audit.EVENT" in the log, with the name of the caller's token and its role. The lines hold no
 * patient data: a session appears as the first digits of its random id, and a volume, whose id a client chose, as a
 * hash that is salted anew at every start. I/O thread. */
#ifndef TCS_ACCESS_AUDIT_H
#define TCS_ACCESS_AUDIT_H

#include "server/access/access.h"

/* event: "session.create" ...; session and volume: ids, or NULL. */
void tcs_audit(tcs_access *access, const tcs_caller *caller, const char *event, const char *session,
               const char *volume);
/* A request was refused; why: "host", "origin", "token", "role", "session". A flood of refusals is logged as a count.
 */
void tcs_audit_refused(tcs_access *access, const tcs_caller *caller, const char *why);

#endif
