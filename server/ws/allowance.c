#include "server/ws/allowance.h"

#include <glib.h>

void tcs_allowance_init(tcs_allowance *allowance, int64_t now_us) {
  *allowance = (tcs_allowance){TCS_ALLOWANCE_CREDIT_US, now_us};
}

int64_t tcs_allowance_spend(tcs_allowance *allowance, int64_t now_us, int64_t cpu_us) {
  const int64_t earned_us = (now_us - allowance->at_us) / TCS_ALLOWANCE;
  allowance->credit_us = MIN(allowance->credit_us + earned_us, TCS_ALLOWANCE_CREDIT_US) - cpu_us;
  allowance->at_us = now_us;
  return allowance->credit_us < 0 ? now_us - allowance->credit_us * TCS_ALLOWANCE : 0;
}
