/* The scheduler: jobs of clients (client.h) take turns on the render thread in time slices, in the order of fair.h. A
 * job whose slice ends while others wait is paused with its frame and resumes at its next turn. Encoding runs in
 * parallel, with a separate encoder for interactive frames. I/O thread only.
 *
 *   fair        order of the turns: pure
 *   job         one picture to render
 *   client      a queue of jobs with an account of render time
 *   scheduler   slices on the render thread, encoding
 *   ladder      size of interactive frames: pure */
#ifndef TCS_SCHEDULE_SCHEDULER_H
#define TCS_SCHEDULE_SCHEDULER_H

#include "renderer/quality/cost.h"
#include "server/schedule/client.h"

/* Creates the renderer on its thread and waits for it. */
tcs_scheduler *tcs_scheduler_new(tcs_server *server, GError **error);
/* Frees the renderer on its thread. No job may be queued or running, and all clients have left. */
void tcs_scheduler_free(tcs_scheduler *scheduler);
const tc_renderer_info *tcs_scheduler_about(const tcs_scheduler *scheduler);
/* Cost model from all frames so far, for single pictures and new sessions. Owned by the scheduler. */
tc_quality_cost *tcs_scheduler_cost(tcs_scheduler *scheduler);
/* Recent milliseconds per sample (tc_estimate_samples()); a guess before the first picture. */
double tcs_scheduler_ms_per_sample(const tcs_scheduler *scheduler);
/* Target render time of an interactive frame: TCS_LADDER_TARGET_MS, or one slice while several clients interact, since
 * a frame split over two turns arrives later than two whole ones. */
double tcs_scheduler_moving_ms(const tcs_scheduler *scheduler);

/* A client that makes its jobs when its turn comes: the viewers of a session. */
tcs_client *tcs_scheduler_join(tcs_scheduler *scheduler, const char *peer, tcs_client_next *next, void *user);
/* The client's queued jobs must have been cancelled. */
void tcs_scheduler_leave(tcs_scheduler *scheduler, tcs_client *client);
/* Queues a single picture of job->peer. TC_ERROR_BUSY when too many wait: the caller keeps the job. */
bool tcs_scheduler_submit(tcs_scheduler *scheduler, tcs_job *job, GError **error);
/* Queues a preparation of job->peer (prepare_only) behind all pictures, in the class of refinements. It ends early if it
 * lacks memory, makes no progress in its slices, or finds half of the renderer's cache in use: its resources must not
 * replace those of pictures. */
void tcs_scheduler_prepare(tcs_scheduler *scheduler, tcs_job *job);
/* Starts a waiting job, or tells the running one when to pause for those waiting. Call after every change. */
void tcs_scheduler_pump(tcs_scheduler *scheduler);
/* Cancels a job: a waiting job is finished (and freed) at once, a running one soon. */
void tcs_job_cancel(tcs_job *job);
/* Evicts the renderer's least recently used resources down to this size. */
void tcs_scheduler_trim_cache(tcs_scheduler *scheduler, uint64_t most_bytes);
/* Frees the renderer's resources of a removed volume. */
void tcs_scheduler_forget(tcs_scheduler *scheduler, tc_volume *volume);
void tcs_scheduler_forget_mesh(tcs_scheduler *scheduler, uint64_t serial); /* of a removed mesh */
/* Cancels a picture that exceeds the configured time; forgets idle peers. About once a second. */
void tcs_scheduler_tick(tcs_scheduler *scheduler, int64_t now_us);
int tcs_scheduler_waiting(const tcs_scheduler *scheduler);
/* No job is queued, rendering or being encoded. */
bool tcs_scheduler_idle(const tcs_scheduler *scheduler);

#endif
