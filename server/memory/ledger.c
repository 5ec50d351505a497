#include "server/memory/ledger.h"

static void count(void *user, int64_t bytes) {
  tcs_ledger *l = user;
  atomic_fetch_add(&l->held, bytes);
  if (bytes > 0)
    tcs_budget_count(l->budget, l->kind, (uint64_t)bytes);
  else
    tcs_budget_give(l->budget, l->kind, (uint64_t)-bytes);
}

static bool take(void *user, uint64_t bytes) {
  tcs_ledger *l = user;
  const bool fits = tcs_budget_resize(l->budget, l->kind, 0, bytes);
  if (fits) {
    atomic_fetch_add(&l->held, (int_fast64_t)bytes);
  } else {
    atomic_store(&l->held_then, atomic_load(&l->held));
    atomic_store(&l->refused, (int_fast64_t)bytes);
  }
  return fits;
}

void tcs_ledger_init(tcs_ledger *l, tcs_budget *budget, tcs_memory_kind kind) {
  l->ask = (tc_ledger){take, count, l};
  l->budget = budget;
  l->kind = kind;
  atomic_init(&l->held, 0);
  atomic_init(&l->refused, 0);
  atomic_init(&l->held_then, 0);
}

void tcs_ledger_begin(tcs_ledger *l) { atomic_store(&l->refused, 0); }
void tcs_ledger_end(tcs_ledger *l) { count(l, -atomic_load(&l->held)); }
