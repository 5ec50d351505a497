/* Who renders next, and for how long: jobs of clients (client.h) take turns on the render thread by fair.h, in slices.
 * One whose slice is over while others wait is paused, keeps its frame and goes on at its next turn. Its pictures are
 * encoded while others render, interactive frames apart from the rest. I/O thread only.
 *
 *   fair        whose turn it is: pure
 *   job         one picture to make
 *   client      a line of jobs with an account of render time
 *   scheduler   slices on the render thread, encoding
 *   ladder      how small an interactive frame must be: pure */
#ifndef TCS_SCHEDULE_SCHEDULER_H
#define TCS_SCHEDULE_SCHEDULER_H

#include "renderer/quality/cost.h"
#include "server/schedule/client.h"

/* Starts the renderer on its thread and waits for it. */
tcs_scheduler *tcs_scheduler_new(tcs_server *server, GError **error);
/* Frees the renderer on its thread. Nothing may be queued or under way any more, and all clients have left. */
void tcs_scheduler_free(tcs_scheduler *scheduler);
const tc_renderer_info *tcs_scheduler_about(const tcs_scheduler *scheduler);
/* Of all frames so far: for single pictures, and where a session begins. The scheduler's. */
tc_quality_cost *tcs_scheduler_cost(tcs_scheduler *scheduler);
/* What a sample (tc_estimate_samples()) took of pictures lately; before the first one a guess. */
double tcs_scheduler_ms_per_sample(const tcs_scheduler *scheduler);
/* How long an interactive frame may take to render: a frame of TCS_LADDER_TARGET_MS, or one slice while other
 * clients drag too, for a frame that is cut between two turns comes later than two that are not. */
double tcs_scheduler_moving_ms(const tcs_scheduler *scheduler);

/* A client whose jobs are made when its turn comes: the viewers of a session. */
tcs_client *tcs_scheduler_join(tcs_scheduler *scheduler, const char *peer, tcs_client_next *next, void *user);
/* Its jobs in line were cancelled before. */
void tcs_scheduler_leave(tcs_scheduler *scheduler, tcs_client *client);
/* Queues a single picture of job->peer. TC_ERROR_BUSY when too many wait: the job stays the caller's. */
bool tcs_scheduler_submit(tcs_scheduler *scheduler, tcs_job *job, GError **error);
/* Starts what can start, and lets what is under way give way to what waits now. Call after anything changed. */
void tcs_scheduler_pump(tcs_scheduler *scheduler);
/* Nobody wants the job any more: one in line is finished at once (and freed), one under way soon. */
void tcs_job_cancel(tcs_job *job);
/* Makes the renderer drop least recently used derived data until it keeps no more than this. */
void tcs_scheduler_trim_cache(tcs_scheduler *scheduler, uint64_t most_bytes);
/* Drops the renderer's resources of a volume that goes away. */
void tcs_scheduler_forget(tcs_scheduler *scheduler, tc_volume *volume);
void tcs_scheduler_forget_mesh(tcs_scheduler *scheduler, uint64_t serial); /* likewise of a mesh */
/* Gives up a picture that takes longer than the configured time; forgets peers. About once a second. */
void tcs_scheduler_tick(tcs_scheduler *scheduler, int64_t now_us);
int tcs_scheduler_waiting(const tcs_scheduler *scheduler);
/* Nothing is queued, rendering or being encoded. */
bool tcs_scheduler_idle(const tcs_scheduler *scheduler);

#endif
