/* Quality control of frames: scenes that ask for a bound on error or time get their sampling here before they are
 * rendered. Models of the error, which either bound chooses by, belong to a look (renderer/quality/quality.h), are
 * shared by all sessions and grow by measurements on a thread of low priority with a renderer of its own. I/O thread
 * only. */
#ifndef TCS_SESSION_QUALITY_CONTROL_H
#define TCS_SESSION_QUALITY_CONTROL_H

#include "renderer/quality/cost.h"
#include "renderer/quality/quality.h"
#include "server/session/session.h"

tcs_quality *tcs_quality_new(tcs_server *server);
/* Ends what is under way; the worker may be freed afterwards, then its completions drained, then this freed. */
void tcs_quality_cancel_all(tcs_quality *quality);
void tcs_quality_free(tcs_quality *quality); /* NULL is fine */

/* Whether a frame of the scene is lit, and by cheaper gradients while it moves: it costs otherwise than one at rest. */
bool tcs_quality_lit_in_motion(const tc_scene *scene, bool moving);
/* Where the scene asks for a bound: puts method, step and termination into the job's scene and the reason into
 * job->quality. session: the session of the frame, whose times and present method count; NULL: none. In motion a bound
 * on time is at most the time of an interactive frame, and a bound on error never takes steps finer than the scene's
 * own. */
void tcs_quality_resolve(tcs_quality *quality, tcs_job *job, const tcs_session *session, bool moving);
/* For a single picture under a bound on error: measures its look first where no camera near this one was measured, then
 * queues the job. False: the measurement is not needed, and the job is still the caller's. */
bool tcs_quality_prepare(tcs_quality *quality, tcs_job *job);
/* Measures what would help the sessions at rest, one view at a time. Call after a final frame. */
void tcs_quality_pump(tcs_quality *quality);
/* The session's scene or viewers changed: cancels measurements of looks that no viewer sees any more. */
void tcs_quality_changed(tcs_quality *quality, const tcs_session *session);

/* What was chosen, for the plan. NULL where nothing was asked. */
cJSON *tcs_quality_json(const tcs_job *job);

#endif
