/* Quality control: chooses the sampling of scenes that set a bound on error or time. The error models belong to a look,
 * that is everything of a scene that its error depends on except camera and sampling (renderer/quality/quality.h). All
 * sessions share them, and they improve by measurements on a thread of low priority with its own renderer. I/O thread
 * only. */
#ifndef TCS_SESSION_QUALITY_CONTROL_H
#define TCS_SESSION_QUALITY_CONTROL_H

#include "renderer/quality/cost.h"
#include "renderer/quality/quality.h"
#include "server/session/session.h"

tcs_quality *tcs_quality_new(tcs_server *server);
/* Cancels running measurements. At shutdown: then free the worker, drain its completions, and call tcs_quality_free().
 */
void tcs_quality_cancel_all(tcs_quality *quality);
void tcs_quality_free(tcs_quality *quality); /* NULL is fine */

/* Whether a frame is lit in motion, with cheaper gradients, so that its cost differs from that of a frame at rest. */
bool tcs_quality_lit_in_motion(const tc_scene *scene, bool moving);
/* If the scene sets a bound: writes method, step and termination into the job's scene and the reason into job->quality.
 * session: whose frame times and current method are used; NULL: none. In motion a bound on time is at most the time of
 * an interactive frame, and a bound on error never makes the step finer than the scene's own. */
void tcs_quality_resolve(tcs_quality *quality, tcs_job *job, const tcs_session *session, bool moving);
/* For a single picture with a bound on error: if no camera near this one was measured for its look, measures and then
 * queues the job. False: no measurement needed, and the caller keeps the job. */
bool tcs_quality_prepare(tcs_quality *quality, tcs_job *job);
/* Measures what helps sessions at rest, one view at a time. Call after a final frame. */
void tcs_quality_pump(tcs_quality *quality);
/* The session's scene or viewers changed: cancels measurements of looks that no viewer sees any more. */
void tcs_quality_changed(tcs_quality *quality, const tcs_session *session);

/* The choice, for the plan. NULL if the scene set no bound. */
cJSON *tcs_quality_json(const tcs_job *job);

#endif
