#include "server/ws/share.h"

#include <glib.h>

void tcs_share_init(tcs_share *share, int64_t now_us) { *share = (tcs_share){TCS_SHARE_CREDIT_US, now_us}; }

int64_t tcs_share_spend(tcs_share *share, int64_t now_us, int64_t cpu_us) {
  const int64_t earned_us = (now_us - share->at_us) / TCS_SHARE;
  share->credit_us = MIN(share->credit_us + earned_us, TCS_SHARE_CREDIT_US) - cpu_us;
  share->at_us = now_us;
  return share->credit_us < 0 ? now_us - share->credit_us * TCS_SHARE : 0;
}
