/* Memory accounting of the process. The renderer reserves bytes here before a large allocation and returns them when it
 * frees. */
#ifndef TC_RENDERER_LEDGER_H
#define TC_RENDERER_LEDGER_H

#include <stdbool.h>
#include <stdint.h>

typedef struct tc_ledger {
  bool (*take)(void *user, uint64_t bytes);  /* reserves bytes; false: the budget is exhausted. Any thread */
  void (*count)(void *user, int64_t bytes);  /* adds bytes already allocated; negative: returns bytes. Any thread */
  void *user;
} tc_ledger;

/* ledger NULL: unbounded. */
static inline bool tc_ledger_take(const tc_ledger *ledger, uint64_t bytes) {
  return !ledger || !bytes || ledger->take(ledger->user, bytes);
}

static inline void tc_ledger_count(const tc_ledger *ledger, int64_t bytes) {
  if (ledger && bytes) ledger->count(ledger->user, bytes);
}

#endif
