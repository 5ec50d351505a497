#include "server/schedule/room.h"

/* Bytes per pixel for encoding: those of noise as PNG. */
#define ENCODING_BYTES 4

/* Peak memory of the job until it is encoded. */
static uint64_t frame_need(const tcs_job *job) {
  const int width = job->width ? job->width : job->scene.image.width;
  const int height = job->height ? job->height : job->scene.image.height;
  const uint64_t drawn = tc_frame_need(&job->scene, width, height, job->meter_pixels > 0);
  if (job->plan_only || job->pick_only) return tc_frame_bytes(&job->frame);
  return MAX(drawn, tc_frame_bytes(&job->frame)) + (uint64_t)width * (uint64_t)height * ENCODING_BYTES;
}

static void refuse(tcs_job *job, tcs_memory_kind kind, uint64_t wanted) {
  job->memory_wanted = wanted;
  tcs_budget_refuse(job->server->budget, kind, wanted, &job->error);
}

bool tcs_job_take_memory(tcs_job *job) {
  const uint64_t need = frame_need(job);
  const bool fits = tcs_budget_resize(job->server->budget, TCS_MEMORY_FRAMES, job->memory, need);
  if (fits)
    job->memory = need;
  else
    refuse(job, TCS_MEMORY_FRAMES, need - job->memory);
  return fits;
}

void tcs_job_count_memory(tcs_job *job, uint64_t bytes) {
  tcs_budget_give(job->server->budget, TCS_MEMORY_FRAMES, job->memory);
  tcs_budget_count(job->server->budget, TCS_MEMORY_FRAMES, bytes);
  job->memory = bytes;
}

void tcs_job_recount_memory(tcs_job *job) {
  GError *paused = g_error_matches(job->error, TC_ERROR, TC_ERROR_PAUSED) ? g_steal_pointer(&job->error) : NULL;
  if (job->error)
    tcs_job_count_memory(job, tc_frame_bytes(&job->frame));
  else if (tcs_job_take_memory(job))
    job->error = g_steal_pointer(&paused);
  g_clear_error(&paused);
}

void tcs_job_refused(tcs_job *job, const tcs_ledger *ledger, int64_t bytes) {
  if (!g_error_matches(job->error, TC_ERROR, TC_ERROR_MEMORY) || !bytes) return;
  g_clear_error(&job->error);
  refuse(job, ledger->kind, (uint64_t)bytes);
}
