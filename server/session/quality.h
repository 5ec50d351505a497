/* Quality control of frames: scenes that ask for a bound on error or time get their sampling here before they are
 * rendered. Models of the error, which either bound chooses by, belong to a look (renderer/quality/quality.h), are
 * shared by all sessions and grow by measurements on a thread of low priority with a renderer of its own. I/O thread
 * only. */
#ifndef TCS_SESSION_QUALITY_H
#define TCS_SESSION_QUALITY_H

#include "renderer/quality/cost.h"
#include "renderer/quality/quality.h"
#include "server/session/session.h"

tcs_quality *tcs_quality_new(tcs_server *server);
/* Ends what is under way; the worker may be freed afterwards, then its completions drained, then this freed. */
void tcs_quality_cancel_all(tcs_quality *quality);
void tcs_quality_free(tcs_quality *quality); /* NULL is fine */

/* Puts method, step and termination into the job's scene and the why into job->quality, where the scene asks for either
 * bound. session: whose frame it is, its times and the method in use count; NULL: nobody's. Of a moving frame the bound
 * on time is no longer than a frame in motion may take; under one on error it never takes finer steps than its scene
 * has. */
void tcs_quality_resolve(tcs_quality *quality, tcs_job *job, const tcs_session *session, bool moving);
/* A single picture under a bound on its error whose look was never measured near its camera: measures it, then queues
 * the job. False: nothing to wait for, the job is still the caller's. */
bool tcs_quality_prepare(tcs_quality *quality, tcs_job *job);
/* Measures what would help the sessions at rest, one view at a time. Call after a final frame. */
void tcs_quality_pump(tcs_quality *quality);
/* The session's scene or viewers changed: a measurement of a look that nobody sees any more is in vain. */
void tcs_quality_changed(tcs_quality *quality, const tcs_session *session);

/* What was chosen, for the plan. NULL where nothing was asked. */
cJSON *tcs_quality_json(const tcs_job *job);

#endif
