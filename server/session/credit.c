#include "server/session/credit.h"

void tcs_credit_init(tcs_credit *credit, unsigned limit) { *credit = (tcs_credit){.limit = limit ? limit : 1}; }

unsigned tcs_credit_pending(const tcs_credit *credit) { return (unsigned)(credit->sent - credit->acked); }

bool tcs_credit_open(const tcs_credit *credit, int64_t now_us) {
  const unsigned pending = tcs_credit_pending(credit);
  if (pending == 0) return true;
  return pending < credit->limit && now_us - credit->waiting_us < TCS_CREDIT_STALL_US;
}

uint64_t tcs_credit_send(tcs_credit *credit, int64_t now_us) {
  if (tcs_credit_pending(credit) == 0) credit->waiting_us = now_us;
  return ++credit->sent;
}

bool tcs_credit_ack(tcs_credit *credit, uint64_t frame, int64_t now_us) {
  if (frame > credit->sent) return false;
  if (frame > credit->acked) {
    credit->acked = frame;
    credit->waiting_us = now_us;
  }
  return true;
}
