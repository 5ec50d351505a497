/* How a render checks its tc_interrupt, on any of its threads. Private to the renderer.
 *
 * A render whose pause time is already past when it begins still makes progress, so that a frame that is resumed again
 * and again is done in the end: its grace begins with the render. */
#ifndef TC_RENDERER_HALT_H
#define TC_RENDERER_HALT_H

#include <stdint.h>

#include "renderer/base/error.h"
#include "renderer/base/interrupt.h"

typedef struct tc_halt { /* named once more in raycast/cpu/kernels.h */
  const tc_interrupt *interrupt; /* NULL: nobody asks */
  int64_t begun_us, grace_us;
} tc_halt;

/* Begins now. fruitless: how many renders in a row before this one were paused before they made progress; the grace
 * doubles with each. */
tc_halt tc_halt_begin(const tc_interrupt *interrupt, int fruitless);

/* Between two units of work: stop here? halt may be NULL: never. */
bool tc_halt_between(const tc_halt *halt);
/* Within a unit: stop? */
bool tc_halt_within(const tc_halt *halt);

/* Sets the error, TC_ERROR_CANCELLED or TC_ERROR_PAUSED; returns false. */
bool tc_halt_say(const tc_halt *halt, GError **error);

#ifdef TC_TEST_BUILD
/* How often and how soon work checks, for tests. Set while nothing renders. */
typedef struct tc_halt_probe {
  bool on;
  long long cancels_at;        /* from this check on every one says stop; LLONG_MAX: none */
  atomic_llong looks;          /* checks so far, of all threads */
  atomic_llong longest_us;     /* a thread's own processor time between two checks, or a check and the beginning */
} tc_halt_probe;
extern tc_halt_probe tc_halt_probed;

void tc_halt_probe_begin(long long cancels_at);
#endif

#endif
