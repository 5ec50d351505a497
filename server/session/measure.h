/* The error meter of a session: after a final picture its sampled pixels are integrated anew on a thread of low
 * priority; what is found goes into the picture's header, and viewers get it once more. I/O thread only.
 *
 * At most one measurement of a session counts: a change of the scene ends it, and so does the session's end. */
#ifndef TCS_SESSION_MEASURE_H
#define TCS_SESSION_MEASURE_H

#include "server/session/session.h"

/* Takes the job's meter, volume and scene for the picture that it made, one of the session's. */
void tcs_measure_begin(tcs_session *session, tcs_job *job, tcs_picture *picture);
/* NULL session->measure is fine. */
void tcs_measure_cancel(tcs_session *session);

#endif
