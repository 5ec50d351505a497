#include "renderer/base/pool.h"

#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#define MAX_THREADS 256

typedef struct tc_worker {
  tc_pool *pool;
  pthread_t thread;
  int number;
} tc_worker;

struct tc_pool {
  int threads; /* the caller included */
  int started;
  tc_worker *workers; /* [threads - 1] */
  pthread_mutex_t lock;
  pthread_cond_t work, done;
  uint64_t round; /* counts calls of tc_pool_run */
  bool open;      /* the caller is in the round; workers that wake after it left skip the round and are not waited
                     for */
  int busy;       /* workers in the round */
  bool stop;
  void (*task)(void *, int, int);
  void *context;
  int count;
  atomic_int next;
  const tc_halt *halt;
};

static void drain(tc_pool *pool, int worker) {
  while (!tc_halt_within(pool->halt)) { /* checked before an index is taken: every taken index is processed */
    int i = atomic_fetch_add_explicit(&pool->next, 1, memory_order_relaxed);
    if (i >= pool->count) return;
    pool->task(pool->context, i, worker);
  }
}

static void *worker_main(void *argument) {
  tc_worker *self = argument;
  tc_pool *pool = self->pool;
  char name[16];
  snprintf(name, sizeof name, "render-%d", self->number % 1000);
  pthread_setname_np(pthread_self(), name);
  uint64_t seen = 0;
  pthread_mutex_lock(&pool->lock);
  for (;;) {
    while (!pool->stop && pool->round == seen) pthread_cond_wait(&pool->work, &pool->lock);
    if (pool->stop) break;
    seen = pool->round;
    if (!pool->open) continue;
    pool->busy++;
    pthread_mutex_unlock(&pool->lock);
    drain(pool, self->number);
    pthread_mutex_lock(&pool->lock);
    if (--pool->busy == 0) pthread_cond_signal(&pool->done);
  }
  pthread_mutex_unlock(&pool->lock);
  return NULL;
}

tc_pool *tc_pool_new(int threads, GError **error) {
  if (threads <= 0) threads = (int)sysconf(_SC_NPROCESSORS_ONLN);
  if (threads < 1) threads = 1;
  if (threads > MAX_THREADS) threads = MAX_THREADS;
  tc_pool *pool = calloc(1, sizeof *pool);
  tc_worker *workers = calloc((size_t)threads, sizeof *workers);
  if (!pool || !workers) {
    free(pool);
    free(workers);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "worker threads: out of memory");
    return NULL;
  }
  pool->threads = threads;
  pool->workers = workers;
  pthread_mutex_init(&pool->lock, NULL);
  pthread_cond_init(&pool->work, NULL);
  pthread_cond_init(&pool->done, NULL);
  for (int i = 0; i < threads - 1; i++) {
    pool->workers[i] = (tc_worker){.pool = pool, .number = i + 1};
    if (pthread_create(&pool->workers[i].thread, NULL, worker_main, &pool->workers[i])) {
      tc_pool_free(pool);
      tc_set_error(error, TC_ERROR_IO, NULL, "worker threads: the system refused thread %d of %d", i + 1, threads);
      return NULL;
    }
    pool->started++;
  }
  return pool;
}

void tc_pool_free(tc_pool *pool) {
  if (!pool) return;
  pthread_mutex_lock(&pool->lock);
  pool->stop = true;
  pthread_cond_broadcast(&pool->work);
  pthread_mutex_unlock(&pool->lock);
  for (int i = 0; i < pool->started; i++) pthread_join(pool->workers[i].thread, NULL);
  pthread_cond_destroy(&pool->done);
  pthread_cond_destroy(&pool->work);
  pthread_mutex_destroy(&pool->lock);
  free(pool->workers);
  free(pool);
}

int tc_pool_threads(const tc_pool *pool) { return pool ? pool->threads : 1; }

void tc_pool_watch(tc_pool *pool, const tc_halt *halt) { pool->halt = halt; }

const tc_halt *tc_pool_halt(const tc_pool *pool) { return pool ? pool->halt : NULL; }

bool tc_pool_run(tc_pool *pool, int count, void (*task)(void *context, int index, int worker), void *context) {
  int next = 0;
  return tc_pool_go_on(pool, &next, count, task, context);
}

bool tc_pool_go_on(tc_pool *pool, int *next, int count, void (*task)(void *context, int index, int worker),
                   void *context) {
  if (!pool || pool->started == 0 || count - *next <= 1) {
    for (; *next < count && !tc_halt_within(tc_pool_halt(pool)); ++*next) task(context, *next, 0);
    return *next >= count;
  }
  pthread_mutex_lock(&pool->lock);
  pool->task = task;
  pool->context = context;
  pool->count = count;
  atomic_store_explicit(&pool->next, *next, memory_order_relaxed);
  pool->open = true;
  pool->round++;
  pthread_cond_broadcast(&pool->work);
  pthread_mutex_unlock(&pool->lock);
  drain(pool, 0);
  pthread_mutex_lock(&pool->lock);
  pool->open = false;
  while (pool->busy) pthread_cond_wait(&pool->done, &pool->lock);
  pthread_mutex_unlock(&pool->lock);
  int taken = atomic_load_explicit(&pool->next, memory_order_relaxed);
  *next = taken < count ? taken : count;
  return *next == count;
}
