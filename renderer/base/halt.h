/* A render's check of its tc_interrupt, from any of its threads. Private to the renderer.
 *
 * The grace period (TC_GRACE_US) starts at the pause time or at the start of the render, whichever is later. A render
 * that starts after its pause time therefore still makes progress, so that a frame resumed often enough is finished. */
#ifndef TC_RENDERER_HALT_H
#define TC_RENDERER_HALT_H

#include <stdint.h>

#include "renderer/base/error.h"
#include "renderer/base/interrupt.h"

typedef struct tc_halt { /* raycast/cpu/kernels.h has a forward declaration */
  const tc_interrupt *interrupt; /* NULL: never interrupted */
  int64_t begun_us, grace_us;
} tc_halt;

/* Starts the clock. fruitless: number of preceding renders that were paused before they made any progress; each one
 * doubles the grace period. */
tc_halt tc_halt_begin(const tc_interrupt *interrupt, int fruitless);

/* Check between two units of work, without grace: true = stop. halt NULL: never stops. */
bool tc_halt_between(const tc_halt *halt);
/* Check inside a unit, with grace: true = stop. halt NULL: never stops. */
bool tc_halt_within(const tc_halt *halt);

/* Sets the error, TC_ERROR_CANCELLED or TC_ERROR_PAUSED; returns false. */
bool tc_halt_say(const tc_halt *halt, GError **error);

#ifdef TC_TEST_BUILD
/* Test probe of how often and how regularly the halt is checked. Change it only while nothing renders. */
typedef struct tc_halt_probe {
  bool on;
  long long cancels_at;        /* number of the first check that returns stop, as do all later ones; LLONG_MAX: none */
  atomic_llong looks;          /* checks so far, on all threads */
  atomic_llong longest_us;     /* longest CPU time of one thread between two of its checks */
} tc_halt_probe;
extern tc_halt_probe tc_halt_probed;

void tc_halt_probe_begin(long long cancels_at);
#endif

#endif
