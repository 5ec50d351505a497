/* Memory of a render job: its frame, and the memory for drawing and encoding. Render thread unless stated otherwise. */
#ifndef TCS_SCHEDULE_ROOM_H
#define TCS_SCHEDULE_ROOM_H

#include "server/schedule/job.h"

/* Reserves the memory of the job's frame. False: job->error and job->memory_wanted are set. */
bool tcs_job_take_memory(tcs_job *job);
/* Replaces the reservation by the actual bytes of the frame. Also on the encode thread. */
void tcs_job_count_memory(tcs_job *job, uint64_t bytes);
/* Updates the reservation after a slice, since a paused frame may hold more than before. Sets job->error if refused. */
void tcs_job_recount_memory(tcs_job *job);
/* If the job failed for lack of memory and the ledger refused `bytes` (0: it did not), replaces the error by
 * TC_ERROR_BUSY and sets job->memory_wanted, so that the job can be retried. */
void tcs_job_refused(tcs_job *job, const tcs_ledger *ledger, int64_t bytes);

#endif
