/* Rate limit of a viewer's messages: 1 / TCS_ALLOWANCE of the I/O thread's time, plus a credit for bursts. Counted in
 * processor time, since waits of the I/O thread on a busy machine are not the viewer's fault. Plain data, one thread;
 * microseconds, at_us on one monotonic clock. */
#ifndef TCS_WS_ALLOWANCE_H
#define TCS_WS_ALLOWANCE_H

#include <stdint.h>

#define TCS_ALLOWANCE 20 /* sixty patches a second take a thousandth of the time */
#define TCS_ALLOWANCE_CREDIT_US 10000

typedef struct tcs_allowance {
  int64_t credit_us, at_us; /* credit_us: the credit at time at_us */
} tcs_allowance;

void tcs_allowance_init(tcs_allowance *allowance, int64_t now_us);
/* Charges a read that began at now_us and took cpu_us of processor time. Returns when the next read may begin; 0 = at
 * once. */
int64_t tcs_allowance_spend(tcs_allowance *allowance, int64_t now_us, int64_t cpu_us);

#endif
