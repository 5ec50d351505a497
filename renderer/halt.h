/* A render's look at its tc_interrupt, for all who work on it: any thread. Private to the renderer.
 *
 * A pause that is over already when a render begins lets it do something all the same, so that a frame that is resumed
 * again and again gets done: its grace begins with the render. */
#ifndef TC_RENDERER_HALT_H
#define TC_RENDERER_HALT_H

#include <stdint.h>

#include "renderer/error.h"
#include "renderer/interrupt.h"

typedef struct tc_halt { /* named once more in raycast/cpu/kernels.h */
  const tc_interrupt *interrupt; /* NULL: nobody asks */
  int64_t begun_us, grace_us;
} tc_halt;

/* From now on. fruitless: how many renders before this one were paused before they came any further: the grace doubles
 * with each, so that what takes longer than it gets done at last. */
tc_halt tc_halt_begin(const tc_interrupt *interrupt, int fruitless);

/* Between two pieces of work: stop here? halt may be NULL: never. */
bool tc_halt_between(const tc_halt *halt);
/* Within a piece: leave it? */
bool tc_halt_within(const tc_halt *halt);

/* Says why work was left: TC_ERROR_CANCELLED or TC_ERROR_PAUSED. Returns false. */
bool tc_halt_say(const tc_halt *halt, GError **error);

#ifdef TC_TEST_BUILD
/* How often and how soon work looks, for tests. Set while nothing renders. */
typedef struct tc_halt_probe {
  bool on;
  long long cancels_at;        /* from this look on every one is told to give up; LLONG_MAX: none */
  atomic_llong looks;          /* so far, of all threads */
  atomic_llong longest_us;     /* of a thread's own processor time between two looks, or a look and the begin */
} tc_halt_probe;
extern tc_halt_probe tc_halt_probed;

void tc_halt_probe_begin(long long cancels_at);
#endif

#endif
