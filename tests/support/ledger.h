/* A memory ledger with a limit, like the daemon's. */
#ifndef TC_TESTS_LEDGER_H
#define TC_TESTS_LEDGER_H

#include <stdatomic.h>

#include "renderer/base/ledger.h"

typedef struct bounded_ledger {
  tc_ledger ledger;
  atomic_int_fast64_t left, refused;
} bounded_ledger;

static inline bool take_bounded(void *user, uint64_t bytes) {
  bounded_ledger *l = user;
  int_fast64_t left = atomic_load(&l->left);
  while (left >= (int64_t)bytes)
    if (atomic_compare_exchange_weak(&l->left, &left, left - (int64_t)bytes)) return true;
  atomic_store(&l->refused, (int_fast64_t)bytes);
  return false;
}

static inline void count_bounded(void *user, int64_t bytes) { atomic_fetch_sub(&((bounded_ledger *)user)->left, bytes); }

static inline void bound_ledger(bounded_ledger *l, uint64_t bytes) {
  l->ledger = (tc_ledger){take_bounded, count_bounded, l};
  atomic_init(&l->left, (int_fast64_t)bytes);
  atomic_init(&l->refused, 0);
}

#endif
