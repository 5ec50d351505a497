/* Preparation of a resident volume. Its costly part, minima and maxima of boxes, serves every transfer function. */
#include "server/catalogue/own.h"
#include "server/schedule/scheduler.h"

static void finished(tcs_job *job) {
  tcs_entry *entry = job->user;
  if (entry) entry->preparation = NULL;
}

void tcs_preparation_begin(tcs_catalogue *catalogue, tcs_entry *entry, const char *client) {
  if (catalogue->ended) return;
  tcs_job *job = tcs_job_new(catalogue->server, tcs_entry_shown(entry, &entry->defaults), &entry->defaults);
  job->finished = finished;
  job->user = entry;
  job->peer = g_strdup(client);
  entry->preparation = job;
  tcs_scheduler_prepare(catalogue->server->scheduler, job);
}

void tcs_preparation_end(tcs_entry *entry) {
  tcs_job *job = g_steal_pointer(&entry->preparation);
  if (!job) return;
  job->user = NULL;
  tcs_job_cancel(job);
}
