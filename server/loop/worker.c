#include "server/loop/worker.h"

#include <errno.h>
#include <limits.h>
#include <stdint.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

struct tcs_worker {
  pthread_mutex_t mutex;
  pthread_cond_t wake;
  GQueue queue;
  bool stopping;
  tcs_completions *completions;
  char name[16];
  tcs_priority priority;
  GQueue running;
  int most_of_client; /* concurrent tasks of one client */
  uint32_t turn;      /* turn of the last task taken */
  int n_threads;
  pthread_t threads[];
};

static void push(GQueue *tasks, tcs_task *task) {
  task->link = (GList){.data = task};
  g_queue_push_tail_link(tasks, &task->link);
}

bool tcs_completions_init(tcs_completions *completions, GError **error) {
  memset(completions, 0, sizeof *completions);
  completions->event_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
  if (completions->event_fd < 0) {
    tc_set_error(error, TC_ERROR_IO, NULL, "eventfd: %s", g_strerror(errno));
    return false;
  }
  pthread_mutex_init(&completions->mutex, NULL);
  return true;
}

void tcs_completions_finish(tcs_completions *completions) {
  close(completions->event_fd);
  pthread_mutex_destroy(&completions->mutex);
}

static void post(tcs_completions *completions, tcs_task *task) {
  pthread_mutex_lock(&completions->mutex);
  push(&completions->tasks, task);
  pthread_mutex_unlock(&completions->mutex);
  const uint64_t one = 1;
  /* Cannot block: the counter overflows only after 2^64 - 2 unread posts. */
  while (write(completions->event_fd, &one, sizeof one) < 0 && errno == EINTR) {
  }
}

void tcs_completions_drain(tcs_completions *completions) {
  uint64_t count;
  while (read(completions->event_fd, &count, sizeof count) < 0 && errno == EINTR) {
  }
  pthread_mutex_lock(&completions->mutex);
  GQueue tasks = completions->tasks;
  completions->tasks = (GQueue)G_QUEUE_INIT;
  pthread_mutex_unlock(&completions->mutex);
  for (GList *link; (link = g_queue_pop_head_link(&tasks));) {
    tcs_task *task = link->data;
    task->done(task);
    atomic_fetch_sub(&completions->due, 1);
  }
}

static const tcs_task *last_of(const tcs_worker *worker, uint32_t client) {
  const tcs_task *last = NULL;
  for (const GList *link = client ? worker->queue.head : NULL; link; link = link->next)
    if (((const tcs_task *)link->data)->client == client) last = link->data;
  return last;
}

/* Round-robin order: a client's n-th waiting task queues behind the n-th of every other client. */
static void insert(tcs_worker *worker, tcs_task *task) {
  const tcs_task *last = last_of(worker, task->client);
  GList *at = worker->queue.head;
  task->turn = last ? last->turn + 1 : worker->turn;
  task->link = (GList){.data = task};
  while (at && (int32_t)(((const tcs_task *)at->data)->turn - task->turn) <= 0) at = at->next;
  g_queue_insert_before_link(&worker->queue, at, &task->link);
}

static bool may_run(const tcs_worker *worker, const tcs_task *task) {
  int own = 0;
  for (const GList *link = task->client ? worker->running.head : NULL; link; link = link->next)
    own += ((const tcs_task *)link->data)->client == task->client;
  return own < worker->most_of_client || worker->stopping;
}

/* The first task that may run; NULL: none. */
static tcs_task *take(tcs_worker *worker) {
  GList *link = worker->queue.head;
  while (link && !may_run(worker, link->data)) link = link->next;
  if (!link) return NULL;
  tcs_task *task = link->data;
  g_queue_unlink(&worker->queue, link);
  worker->turn = task->turn;
  push(&worker->running, task);
  return task;
}

/* Posts without the lock: the I/O thread wakes at once and may preempt this thread, and would wait for a lock held by a
 * preempted thread of low priority. */
static void run(tcs_worker *worker, tcs_task *task) {
  task->run(task);
  pthread_mutex_lock(&worker->mutex);
  g_queue_unlink(&worker->running, &task->link);
  pthread_mutex_unlock(&worker->mutex);
  post(worker->completions, task);
}

static void *worker_main(void *user) {
  tcs_worker *worker = user;
  pthread_setname_np(pthread_self(), worker->name);
  /* On Linux the nice value is per thread, inherited by the threads it starts. Harmless if refused. */
  if (nice(worker->priority) < 0) errno = 0;
  pthread_mutex_lock(&worker->mutex);
  for (;;) {
    tcs_task *task = take(worker);
    if (task) {
      pthread_mutex_unlock(&worker->mutex);
      run(worker, task);
      pthread_mutex_lock(&worker->mutex);
    } else if (worker->stopping) {
      break;
    } else {
      pthread_cond_wait(&worker->wake, &worker->mutex);
    }
  }
  pthread_mutex_unlock(&worker->mutex);
  return NULL;
}

tcs_worker *tcs_worker_new(const char *name, int threads, tcs_priority priority, tcs_completions *completions,
                           GError **error) {
  tcs_worker *worker = g_malloc0(sizeof *worker + (size_t)threads * sizeof worker->threads[0]);
  pthread_mutex_init(&worker->mutex, NULL);
  pthread_cond_init(&worker->wake, NULL);
  worker->completions = completions;
  worker->priority = priority;
  worker->most_of_client = threads > 1 ? threads - 1 : 1;
  g_strlcpy(worker->name, name, sizeof worker->name);
  for (int i = 0; i < threads; i++) {
    const int failure = pthread_create(&worker->threads[i], NULL, worker_main, worker);
    if (failure) {
      tc_set_error(error, TC_ERROR_IO, NULL, "start thread %s: %s", name, g_strerror(failure));
      tcs_worker_free(worker);
      return NULL;
    }
    worker->n_threads++;
  }
  return worker;
}

bool tcs_worker_offer(tcs_worker *worker, tcs_task *task, int most) {
  pthread_mutex_lock(&worker->mutex);
  const bool room = (int)worker->queue.length < most ||
                    (task->client && (int)worker->queue.length / 2 < most && !last_of(worker, task->client));
  if (room) {
    atomic_fetch_add(&worker->completions->due, 1);
    insert(worker, task);
  }
  pthread_mutex_unlock(&worker->mutex);
  if (room) pthread_cond_signal(&worker->wake);
  return room;
}

void tcs_worker_submit(tcs_worker *worker, tcs_task *task) { tcs_worker_offer(worker, task, INT_MAX); }

bool tcs_worker_drop(tcs_worker *worker, tcs_task *task) {
  pthread_mutex_lock(&worker->mutex);
  const bool dropped = g_queue_link_index(&worker->queue, &task->link) >= 0;
  if (dropped) g_queue_unlink(&worker->queue, &task->link);
  atomic_fetch_sub(&worker->completions->due, dropped);
  pthread_mutex_unlock(&worker->mutex);
  return dropped;
}

int tcs_worker_waiting(tcs_worker *worker) {
  pthread_mutex_lock(&worker->mutex);
  const int waiting = (int)worker->queue.length;
  pthread_mutex_unlock(&worker->mutex);
  return waiting;
}

void tcs_worker_free(tcs_worker *worker) {
  if (!worker) return;
  pthread_mutex_lock(&worker->mutex);
  worker->stopping = true;
  pthread_cond_broadcast(&worker->wake);
  pthread_mutex_unlock(&worker->mutex);
  for (int i = 0; i < worker->n_threads; i++) pthread_join(worker->threads[i], NULL);
  pthread_cond_destroy(&worker->wake);
  pthread_mutex_destroy(&worker->mutex);
  g_free(worker);
}
