/* The daemon's budget as the renderer's ledger (renderer/base/ledger.h): what is reserved under it, and what was refused. */
#ifndef TCS_MEMORY_LEDGER_H
#define TCS_MEMORY_LEDGER_H

#include <stdatomic.h>

#include "renderer/base/ledger.h"
#include "server/memory/budget.h"

typedef struct tcs_ledger {
  tc_ledger ask; /* for the renderer; any thread */
  tcs_budget *budget;
  tcs_memory_kind kind;
  atomic_int_fast64_t held;    /* bytes reserved and counted */
  atomic_int_fast64_t refused, held_then; /* bytes of the last refusal since it began, 0 = none; what was held beside them */
} tcs_ledger;

/* Not copied afterwards, and outlived by the budget. */
void tcs_ledger_init(tcs_ledger *ledger, tcs_budget *budget, tcs_memory_kind kind);
void tcs_ledger_begin(tcs_ledger *ledger); /* forgets refusals */
void tcs_ledger_end(tcs_ledger *ledger);   /* gives back all that is held */

#endif
