/* A render's look at its tc_interrupt, for all who work on it: any thread. Private to the renderer.
 *
 * A pause that is over already when a render begins lets it do something all the same, so that a frame that is resumed
 * again and again gets done: its grace begins with the render. */
#ifndef TC_RENDERER_HALT_H
#define TC_RENDERER_HALT_H

#include <stdint.h>

#include "renderer/error.h"
#include "renderer/interrupt.h"

typedef struct tc_halt {
  const tc_interrupt *interrupt; /* NULL: nobody asks */
  int64_t begun_us;
} tc_halt;

/* From now on. */
tc_halt tc_halt_begin(const tc_interrupt *interrupt);

/* Between two pieces of work: stop here? halt may be NULL: never. */
bool tc_halt_between(const tc_halt *halt);
/* Within a piece: leave it? */
bool tc_halt_within(const tc_halt *halt);

/* Says why work was left: TC_ERROR_CANCELLED or TC_ERROR_PAUSED. Returns false. */
bool tc_halt_say(const tc_halt *halt, GError **error);

#endif
