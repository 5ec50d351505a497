/* How much of the I/O thread one viewer's messages may take: 1 / TCS_ALLOWANCE of its time, beyond a credit for the
 * messages of a moment. Counted in processor time, since a viewer does not answer for the I/O thread's waits on a busy
 * machine. Plain data, one thread; microseconds, at_us on one monotonic clock. */
#ifndef TCS_WS_ALLOWANCE_H
#define TCS_WS_ALLOWANCE_H

#include <stdint.h>

#define TCS_ALLOWANCE 20 /* sixty patches a second take a thousandth */
#define TCS_ALLOWANCE_CREDIT_US 10000

typedef struct tcs_allowance {
  int64_t credit_us, at_us; /* the credit as of at_us */
} tcs_allowance;

void tcs_allowance_init(tcs_allowance *allowance, int64_t now_us);
/* A read that began at now_us took cpu_us of the processor. Returns when the next one may begin; 0 = at once. */
int64_t tcs_allowance_spend(tcs_allowance *allowance, int64_t now_us, int64_t cpu_us);

#endif
