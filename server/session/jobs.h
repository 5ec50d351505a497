/* Render jobs of a session: choice of the next picture, delivery of a finished one. I/O thread only. */
#ifndef TCS_SESSION_JOBS_H
#define TCS_SESSION_JOBS_H

#include "server/session/session.h"

/* A tcs_client_next: the job of the picture that viewers of the session wait for. */
tcs_job *tcs_session_next_job(void *session, tcs_class class);

#endif
