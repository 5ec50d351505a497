/* A session's pictures and failures to its viewers. I/O thread only. */
#ifndef TCS_SESSION_DELIVER_H
#define TCS_SESSION_DELIVER_H

#include "server/session/session.h"

/* The newest picture to every viewer that has something to learn from it. */
void tcs_session_deliver(tcs_session *session);
void tcs_session_deliver_to(tcs_session *session, tcs_watcher *watcher, int64_t now_us);
/* A picture that could not be made: tells the viewers, who wait for no other of its revision. */
void tcs_session_fail(tcs_session *session, const tcs_job *job);
/* tcs_mark: every viewer's newest patch in the scene as it is. */
GArray *tcs_session_marks(const tcs_session *session);
/* Makes the final picture of the scene as it is once more: more is known of its quality. */
void tcs_session_refine(tcs_session *session);

#endif
