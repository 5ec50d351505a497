/* The memory of a picture under way: its frame, and what drawing and encoding take beside it. Render thread, but for what
 * says otherwise. */
#ifndef TCS_SCHEDULE_ROOM_H
#define TCS_SCHEDULE_ROOM_H

#include "server/schedule/job.h"

/* Reserves what its frame needs. False: job->error and ->memory_wanted are set. */
bool tcs_job_take_memory(tcs_job *job);
/* Its frame has so many bytes now, whatever was reserved before; encode thread, too. */
void tcs_job_count_memory(tcs_job *job, uint64_t bytes);
/* After a slice: a paused frame may keep more than it did before. */
void tcs_job_recount_memory(tcs_job *job);
/* Where it failed for want of memory, of which the ledger refused so many bytes (0: none), they may be there later: its
 * error says so. */
void tcs_job_refused(tcs_job *job, const tcs_ledger *ledger, int64_t bytes);

#endif
