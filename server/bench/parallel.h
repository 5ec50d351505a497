/* Parallel loops for measurements that are not timed themselves. */
#ifndef TCS_BENCH_PARALLEL_H
#define TCS_BENCH_PARALLEL_H

/* Calls task(context, index) once for each index in [0, count), in any order, on up to `threads` threads including the
 * caller's. */
void tcs_parallel(int threads, int count, void (*task)(void *context, int index), void *context);

#endif
