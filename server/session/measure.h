/* The error meter of a session: after a final picture, a thread of low priority integrates the sampled pixels again
 * with the reference. The measured error goes into the picture's header, and viewers get the header again. I/O thread
 * only.
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
/* A final picture was made for a single request: it is measured if no viewer's picture is. */
void tcs_session_still(tcs_session *session, tcs_job *job);
/* The meter's result for the present scene, or the reason for having none; NULL: not measured, or not asked. Borrowed.
 */
const tcs_picture *tcs_session_judged(const tcs_session *session);

#endif
