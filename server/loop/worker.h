/* Worker threads and the way back: a task runs on a worker, then its `done` runs on the I/O thread.
 *
 * All state of the daemon belongs to the I/O thread; a task is the only thing that travels. Whoever submits a task
 * hands it over until `done` is called, so tasks need no locks of their own. */
#ifndef TCS_LOOP_WORKER_H
#define TCS_LOOP_WORKER_H

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "renderer/base/error.h"

typedef struct tcs_task tcs_task;
struct tcs_task {
  void (*run)(tcs_task *task);  /* on a worker thread */
  void (*done)(tcs_task *task); /* on the I/O thread afterwards; may free the task */
  GList link;                   /* in the queue it waits in, or among those that run */
  uint32_t client;              /* whose it is; 0: nobody's in particular. Clients take turns at a worker */
  uint32_t turn;                /* the worker's, while it waits */
};

/* Finished tasks on their way to the I/O thread; `event_fd` becomes readable when there are any. */
typedef struct tcs_completions {
  pthread_mutex_t mutex;
  GQueue tasks;
  int event_fd;
  atomic_int due; /* tasks handed to a worker whose `done` has not been called */
} tcs_completions;

bool tcs_completions_init(tcs_completions *completions, GError **error);
void tcs_completions_finish(tcs_completions *completions);
void tcs_completions_drain(tcs_completions *completions); /* I/O thread: calls every `done` */

/* Priorities of threads where processors are short, as steps of nice(2) below the I/O thread. The I/O thread comes
 * first: its turns are short, and all clients wait for them. A thread of three times the weight is rarely preempted. */
typedef enum tcs_priority {
  TCS_PRIORITY_PICTURE = 5, /* pictures that somebody waits for */
  TCS_PRIORITY_BEHIND = 15, /* a tenth of the weight: loads and queries, which clients wait for too */
  TCS_PRIORITY_LOW = 19     /* background work: no client waits for it */
} tcs_priority;

/* `threads` threads called `name` (at most 15 characters) that share one queue. Of one client's tasks the first in is the
 * first out; the tasks of several are taken in turns, and of several threads one client leaves one to the others. */
typedef struct tcs_worker tcs_worker;
tcs_worker *tcs_worker_new(const char *name, int threads, tcs_priority priority, tcs_completions *completions,
                           GError **error);
void tcs_worker_submit(tcs_worker *worker, tcs_task *task);
/* The same, unless `most` tasks wait already: then false, and the task stays the caller's. A client of whom none waits
 * may offer one until there are twice as many. */
bool tcs_worker_offer(tcs_worker *worker, tcs_task *task, int most);
/* Takes a task back that has not begun: neither its `run` nor its `done` is called. False: it has begun, or is over. */
bool tcs_worker_drop(tcs_worker *worker, tcs_task *task);
int tcs_worker_waiting(tcs_worker *worker); /* tasks that have not begun */
/* Runs what is queued, then ends and joins the threads. Their completions are posted, not drained. NULL is fine. */
void tcs_worker_free(tcs_worker *worker);

#endif
