/* Flow control of one viewer: a window on the frames sent and not yet acknowledged.
 *
 * A viewer's frames are numbered 1, 2, 3 ... without gaps, so two numbers describe the window. Plain data, one thread;
 * times are microseconds of one monotonic clock. */
#ifndef TCS_SESSION_CREDIT_H
#define TCS_SESSION_CREDIT_H

#include <stdbool.h>
#include <stdint.h>

/* A viewer without an acknowledgement for this long is stalled: nothing more is sent until it acknowledges. */
#define TCS_CREDIT_STALL_US 4000000

typedef struct tcs_credit {
  unsigned limit;     /* largest number of unacknowledged frames, >= 1 */
  uint64_t sent;      /* number of the last frame sent; 0 = none */
  uint64_t acked;     /* number of the last frame acknowledged */
  int64_t waiting_us; /* send time of the oldest unacknowledged frame */
} tcs_credit;

void tcs_credit_init(tcs_credit *credit, unsigned limit);
bool tcs_credit_open(const tcs_credit *credit, int64_t now_us);
/* Takes the next frame number; only while the window is open. */
uint64_t tcs_credit_send(tcs_credit *credit, int64_t now_us);
/* Acknowledges all frames up to `frame`. False: that frame was never sent. Old acknowledgements are accepted. */
bool tcs_credit_ack(tcs_credit *credit, uint64_t frame, int64_t now_us);
unsigned tcs_credit_pending(const tcs_credit *credit);

#endif
