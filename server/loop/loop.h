/* The I/O thread's event loop: epoll, a completion queue, signals and time.
 *
 * Everything registered is a tcs_source, embedded in what it belongs to. */
#ifndef TCS_LOOP_LOOP_H
#define TCS_LOOP_LOOP_H

#include <stdbool.h>
#include <stdint.h>

#include "renderer/base/error.h"
#include "server/observe/metrics.h"

typedef struct tcs_source tcs_source;
struct tcs_source {
  void (*ready)(tcs_source *source, uint32_t events); /* EPOLLIN ... */
  int fd;
};

typedef struct tcs_loop tcs_loop;
tcs_loop *tcs_loop_new(GError **error);
void tcs_loop_free(tcs_loop *loop); /* NULL is fine */

bool tcs_loop_add(tcs_loop *loop, tcs_source *source, uint32_t events, GError **error);
void tcs_loop_change(tcs_loop *loop, tcs_source *source, uint32_t events);
/* The source gets no further call, not even for events already fetched. */
void tcs_loop_remove(tcs_loop *loop, tcs_source *source);

/* Waits until something is ready or `timeout_ms` (-1 = for ever) has passed and calls what is ready: for TCS_TURN_US at
 * most; what is left over is called by the next call, which then does not wait. From one wait to the next is a turn. */
void tcs_loop_wait(tcs_loop *loop, int timeout_ms);
#define TCS_TURN_US 2000

/* Processor time of the calling thread, microseconds. */
int64_t tcs_thread_cpu_us(void);

/* Where the lengths of turns go; NULL (as it is at first): nowhere. */
void tcs_loop_set_metrics(tcs_loop *loop, tcs_metrics *metrics);

#endif
