/* Worker threads for data-parallel loops. One caller at a time; the caller works too. */
#ifndef TC_RENDERER_POOL_H
#define TC_RENDERER_POOL_H

#include "renderer/base/halt.h"

typedef struct tc_pool tc_pool;

/* threads: including the calling thread; 0 = one per online core. At most 256. TC_ERROR_MEMORY, TC_ERROR_IO. */
tc_pool *tc_pool_new(int threads, GError **error);
void tc_pool_free(tc_pool *pool); /* NULL is fine */
int tc_pool_threads(const tc_pool *pool);

/* Sets the halt that stops the pool's loops (NULL: none), until the next call. The halt is checked before every index,
 * so a task should take a few milliseconds at most. tc_pool_halt(NULL) is NULL. */
void tc_pool_watch(tc_pool *pool, const tc_halt *halt);
const tc_halt *tc_pool_halt(const tc_pool *pool);

/* Calls task(context, index, worker) once for each index in [0, count), in any order, and returns when all are done.
 * worker is in [0, tc_pool_threads()). pool NULL: all on the caller with worker 0. False: halted before the end. */
bool tc_pool_run(tc_pool *pool, int count, void (*task)(void *context, int index, int worker), void *context);
/* As tc_pool_run() for indices [*next, count). Sets *next to the first index not yet processed, from which another call
 * continues. */
bool tc_pool_go_on(tc_pool *pool, int *next, int count, void (*task)(void *context, int index, int worker),
                   void *context);

#endif
