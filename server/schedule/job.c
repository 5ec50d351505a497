#include "server/schedule/job.h"

#include "renderer/mesh/measure.h"
#include "server/memory/budget.h"

tcs_job *tcs_job_new(tcs_server *server, tc_volume *volume, const tc_scene *scene) {
  tcs_job *job = g_new0(tcs_job, 1);
  job->server = server;
  job->volume = tc_volume_ref(volume);
  tc_scene_copy(&job->scene, scene);
  job->class = TCS_CLASS_SINGLE;
  tc_interrupt_init(&job->interrupt);
  job->queued_us = g_get_monotonic_time();
  return job;
}

void tcs_meshes_free(struct tc_mesh **meshes, size_t n) {
  for (size_t i = 0; i < n && meshes; i++) tc_mesh_free(meshes[i]);
  g_free(meshes);
}

void tcs_job_free(tcs_job *job) {
  tc_volume_unref(job->volume);
  tc_volume_unref(job->labels);
  tcs_meshes_free(job->meshes, job->scene.mesh.n_surfaces);
  tc_scene_clear(&job->scene);
  tcs_budget_give(job->server->budget, TCS_MEMORY_FRAMES, job->memory);
  tc_frame_finish(&job->frame);
  g_clear_error(&job->error);
  if (job->image) g_bytes_unref(job->image);
  if (job->marks) g_array_unref(job->marks);
  tc_meter_free(job->meter);
  g_free(job->peer);
  g_free(job);
}

bool tcs_job_begun(const tcs_job *job) { return job->slices > 0; }
