/* Adapter: the daemon's budget behind the renderer's ledger interface (renderer/base/ledger.h), for one kind of memory.
 */
#ifndef TCS_MEMORY_LEDGER_H
#define TCS_MEMORY_LEDGER_H

#include <stdatomic.h>

#include "renderer/base/ledger.h"
#include "server/memory/budget.h"

typedef struct tcs_ledger {
  tc_ledger ask; /* passed to the renderer; any thread */
  tcs_budget *budget;
  tcs_memory_kind kind;
  atomic_int_fast64_t held;    /* bytes reserved and counted */
  atomic_int_fast64_t refused, held_then; /* last refused size since tcs_ledger_begin(), 0 = none; held then */
} tcs_ledger;

/* The budget must outlive the ledger. Do not copy it afterwards. */
void tcs_ledger_init(tcs_ledger *ledger, tcs_budget *budget, tcs_memory_kind kind);
void tcs_ledger_begin(tcs_ledger *ledger); /* resets `refused` */
void tcs_ledger_end(tcs_ledger *ledger);   /* releases everything held */

#endif
