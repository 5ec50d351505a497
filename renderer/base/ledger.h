/* Whoever counts the memory of the process. The renderer asks before it allocates what may be large, and tells what it frees. */
#ifndef TC_RENDERER_LEDGER_H
#define TC_RENDERER_LEDGER_H

#include <stdbool.h>
#include <stdint.h>

typedef struct tc_ledger {
  bool (*take)(void *user, uint64_t bytes);  /* reserves them; false: there are not so many. Any thread */
  void (*count)(void *user, int64_t bytes);  /* exist already, or (negative) are given back. Any thread */
  void *user;
} tc_ledger;

/* ledger NULL: there is no bound. */
static inline bool tc_ledger_take(const tc_ledger *ledger, uint64_t bytes) {
  return !ledger || !bytes || ledger->take(ledger->user, bytes);
}

static inline void tc_ledger_count(const tc_ledger *ledger, int64_t bytes) {
  if (ledger && bytes) ledger->count(ledger->user, bytes);
}

#endif
