/* Worker threads for data-parallel loops. One caller at a time; the caller works too. */
#ifndef TC_RENDERER_POOL_H
#define TC_RENDERER_POOL_H

#include "renderer/error.h"

typedef struct tc_pool tc_pool;

/* `threads` in all, the caller included; 0 = one per online core. */
tc_pool *tc_pool_new(int threads, GError **error);
void tc_pool_free(tc_pool *pool); /* NULL is fine */
int tc_pool_threads(const tc_pool *pool);

/* Calls task(context, index, worker) once for each index in [0, count), in any order, and returns when all are done.
 * worker is in [0, tc_pool_threads()). pool NULL: all on the caller with worker 0. */
void tc_pool_run(tc_pool *pool, int count, void (*task)(void *context, int index, int worker), void *context);

#endif
