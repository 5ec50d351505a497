/* Loops of measurements that are not timed themselves, on several threads. */
#ifndef TCS_BENCH_PARALLEL_H
#define TCS_BENCH_PARALLEL_H

/* Calls task(context, index) once for each index in [0, count), in any order, on up to `threads` threads with the caller's. */
void tcs_parallel(int threads, int count, void (*task)(void *context, int index), void *context);

#endif
