/* The error meter of a session: after a final picture its sampled pixels are integrated anew on a thread of low
 * priority; what is found goes into the picture's header, and viewers get it once more. I/O thread only.
 *
 * At most one measurement of a view counts: a change of the scene ends it, and so does the end of the view. */
#ifndef TCS_SESSION_MEASURE_H
#define TCS_SESSION_MEASURE_H

#include "server/session/session.h"

/* Takes the job's meter, volume and scene for the picture that it made, one of the session's. */
void tcs_measure_begin(tcs_session *session, tcs_view *view, tcs_job *job, tcs_picture *picture);
/* NULL view->measure is fine. */
void tcs_measure_cancel(tcs_view *view);
/* How many pixels of a job's picture the meter is to have: the scene's wish, 0 where there is no reference. */
int tcs_meter_pixels(const tcs_job *job);
/* A final picture was made for one who asked for it alone: it is measured where no viewer's picture is. */
void tcs_session_still(tcs_session *session, tcs_job *job);
/* What the meter found of the scene as it is, or why nothing; NULL: not known, or not asked. The session's. */
const tcs_picture *tcs_session_judged(const tcs_session *session);

#endif
