/* The event loop of the I/O thread: epoll over sockets, completions and signals, with a timeout.
 *
 * Every registered descriptor is a tcs_source, embedded in its owner. */
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

/* Waits until a source is ready or `timeout_ms` (-1 = no limit) has passed, then calls ready sources for at most
 * TCS_TURN_US. The next call continues with the rest without waiting. A turn lasts from one wait to the next. */
void tcs_loop_wait(tcs_loop *loop, int timeout_ms);
#define TCS_TURN_US 2000

/* Processor time of the calling thread, microseconds. */
int64_t tcs_thread_cpu_us(void);

/* Where to record the lengths of turns; NULL (the default): nowhere. */
void tcs_loop_set_metrics(tcs_loop *loop, tcs_metrics *metrics);

#endif
