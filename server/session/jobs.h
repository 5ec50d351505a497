/* What a session has rendered next, and what becomes of it. I/O thread only. */
#ifndef TCS_SESSION_JOBS_H
#define TCS_SESSION_JOBS_H

#include "server/session/session.h"

/* The job of a picture that some viewer waits for and that is not under way, or NULL. */
tcs_job *tcs_session_next_job(tcs_session *session, int64_t now_us);

#endif
