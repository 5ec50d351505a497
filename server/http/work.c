#include "server/http/work.h"

#include <string.h>

char *tcs_json_text(cJSON *json) {
  char *text = cJSON_PrintUnformatted(json);
  cJSON_Delete(json);
  return text ? text : g_strdup("{}");
}

static void free_work(tcs_work *work) {
  if (work->free) work->free(work);
  g_free(work->text);
  g_clear_error(&work->error);
  g_free(work);
}

static void answer(tcs_work *work) {
  tcs_request *request = work->request;
  if (work->reply)
    work->reply(work);
  else if (work->error)
    tcs_reply_error(request, work->error);
  else
    tcs_reply_text(request, 200, "application/json", g_steal_pointer(&work->text));
}

static void run_work(tcs_task *task) {
  tcs_work *work = (tcs_work *)task;
  if (!atomic_load(&work->cancel)) work->run(work);
}

static void done_work(tcs_task *task) {
  tcs_work *work = (tcs_work *)task;
  if (work->request) answer(work);
  free_work(work);
}

static void leave(tcs_request *request) {
  tcs_work *work = request->owner;
  work->request = NULL;
  atomic_store(&work->cancel, true);
  if (!tcs_worker_drop(work->worker, &work->task)) return; /* running: done_work() frees it */
  request->server->metrics->works_dropped++;
  free_work(work);
}

bool tcs_work_start(tcs_request *request, tcs_worker *worker, tcs_work *work, int most) {
  char *peer = tcs_peer_name(request);
  work->task = (tcs_task){.run = run_work, .done = done_work, .client = g_str_hash(peer)};
  g_free(peer);
  work->worker = worker;
  work->request = request;
  if (!tcs_worker_offer(worker, &work->task, most)) {
    tcs_reply_problem(request, 503, "busy", "Busy", "too many requests are waiting; try again in a moment");
    tcs_reply_header(request, "Retry-After", "1");
    free_work(work);
    return false;
  }
  tcs_defer(request, leave, work);
  return true;
}

void tcs_work_inline(tcs_request *request, tcs_work *work) {
  work->request = request;
  work->run(work);
  answer(work);
  free_work(work);
}
