/* The credit window of one viewer: how many frames it has been sent and has not acknowledged.
 *
 * Frames of a viewer are numbered 1, 2, 3 ... without gaps, so two numbers say everything. Plain data, one thread;
 * times are microseconds of one monotonic clock. */
#ifndef TCS_SESSION_CREDIT_H
#define TCS_SESSION_CREDIT_H

#include <stdbool.h>
#include <stdint.h>

/* A viewer that has not acknowledged anything for this long is taken for stalled: nothing more is sent until it does.
 */
#define TCS_CREDIT_STALL_US 4000000

typedef struct tcs_credit {
  unsigned limit;     /* frames that may be under way, >= 1 */
  uint64_t sent;      /* number of the last frame sent; 0 = none */
  uint64_t acked;     /* number of the last frame acknowledged */
  int64_t waiting_us; /* since when the oldest unacknowledged frame waits */
} tcs_credit;

void tcs_credit_init(tcs_credit *credit, unsigned limit);
bool tcs_credit_open(const tcs_credit *credit, int64_t now_us);
/* Takes the next frame number; only while open. */
uint64_t tcs_credit_send(tcs_credit *credit, int64_t now_us);
/* Frame `frame` and all before it arrived. False: that frame was never sent. Old acknowledgements are fine. */
bool tcs_credit_ack(tcs_credit *credit, uint64_t frame, int64_t now_us);
unsigned tcs_credit_pending(const tcs_credit *credit);

#endif
