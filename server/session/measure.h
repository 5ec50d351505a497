/* The error meter of a session: after a final picture a thread of low priority integrates sampled pixels with the
 * reference. The measured error is added to the picture's header, and viewers get the header again. I/O thread only.
 *
 * A view has at most one measurement; a change of the scene or the end of the view cancels it. */
#ifndef TCS_SESSION_MEASURE_H
#define TCS_SESSION_MEASURE_H

#include "server/session/session.h"

/* Starts a measurement of `picture`, one of the session's. Takes the job's meter and meshes; copies or references the
 * rest. */
void tcs_measure_begin(tcs_session *session, tcs_view *view, tcs_job *job, tcs_picture *picture);
/* Cancels the view's measurement, if any. */
void tcs_measure_cancel(tcs_view *view);
/* Number of pixels to keep for the meter: as the scene asks, 0 if the reference cannot integrate the scene. */
int tcs_meter_pixels(const tcs_job *job);
/* A final picture was rendered for a single request: measures it if the session has no viewers. */
void tcs_session_still(tcs_session *session, tcs_job *job);
/* The picture that has the meter's result for the current scene, or the reason for having none. NULL: not measured, or
 * not requested. Borrowed. */
const tcs_picture *tcs_session_judged(const tcs_session *session);

#endif
