/* Worker threads for data-parallel loops. One caller at a time; the caller works too. */
#ifndef TC_RENDERER_POOL_H
#define TC_RENDERER_POOL_H

#include "renderer/base/halt.h"

typedef struct tc_pool tc_pool;

/* `threads` in all, the caller included; 0 = one per online core. */
tc_pool *tc_pool_new(int threads, GError **error);
void tc_pool_free(tc_pool *pool); /* NULL is fine */
int tc_pool_threads(const tc_pool *pool);

/* Until the next call, loops stop where this halt wants work to be left (NULL: never): it is looked at before every index,
 * so a task should take a few milliseconds at most. The pool of NULL has none. */
void tc_pool_watch(tc_pool *pool, const tc_halt *halt);
const tc_halt *tc_pool_halt(const tc_pool *pool);

/* Calls task(context, index, worker) once for each index in [0, count), in any order, and returns when all are done.
 * worker is in [0, tc_pool_threads()). pool NULL: all on the caller with worker 0. False: the halt was before that. */
bool tc_pool_run(tc_pool *pool, int count, void (*task)(void *context, int index, int worker), void *context);
/* The same from *next on, which ends as the first index that was not done: where another call goes on. */
bool tc_pool_go_on(tc_pool *pool, int *next, int count, void (*task)(void *context, int index, int worker),
                   void *context);

#endif
