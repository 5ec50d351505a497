/* Worker threads: a task runs on a worker, then its `done` runs on the I/O thread.
 *
 * All state of the daemon belongs to the I/O thread; only tasks cross threads. The submitter hands a task over until
 * `done` is called, so tasks need no locks. */
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
  GList link;                   /* in the queue, or in the list of running tasks */
  uint32_t client;              /* clients take turns at a worker; 0: no particular client */
  uint32_t turn;                /* the worker's, while the task waits */
};

/* Queue of finished tasks for the I/O thread; `event_fd` becomes readable when it is not empty. */
typedef struct tcs_completions {
  pthread_mutex_t mutex;
  GQueue tasks;
  int event_fd;
  atomic_int due; /* tasks submitted whose `done` has not returned */
} tcs_completions;

bool tcs_completions_init(tcs_completions *completions, GError **error);
void tcs_completions_finish(tcs_completions *completions);
void tcs_completions_drain(tcs_completions *completions); /* I/O thread: calls every `done` */

/* Thread priorities, as steps of nice(2) below the I/O thread. The I/O thread comes first, since its turns are short
 * and all clients wait for them; with three times the weight of the picture threads it is rarely preempted. */
typedef enum tcs_priority {
  TCS_PRIORITY_PICTURE = 5, /* pictures that clients wait for */
  TCS_PRIORITY_BEHIND = 15, /* imports and queries, which clients wait for too: a tenth of the pictures' weight */
  TCS_PRIORITY_LOW = 19     /* background work that no client waits for */
} tcs_priority;

/* Starts `threads` threads called `name` (at most 15 characters) with one queue. One client's tasks run in order,
 * different clients take turns, and with several threads one client never occupies all of them. */
typedef struct tcs_worker tcs_worker;
tcs_worker *tcs_worker_new(const char *name, int threads, tcs_priority priority, tcs_completions *completions,
                           GError **error);
void tcs_worker_submit(tcs_worker *worker, tcs_task *task);
/* Like tcs_worker_submit(), but false if `most` tasks wait already; the caller then keeps the task. For a client
 * without waiting tasks the limit is twice as high. */
bool tcs_worker_offer(tcs_worker *worker, tcs_task *task, int most);
/* Takes back a waiting task; neither `run` nor `done` is called. False: it is running or finished. */
bool tcs_worker_drop(tcs_worker *worker, tcs_task *task);
int tcs_worker_waiting(tcs_worker *worker); /* tasks that have not begun */
/* Finishes the queued tasks, then joins the threads. Completions are posted but not drained. NULL is fine. */
void tcs_worker_free(tcs_worker *worker);

#endif
