/* How a render under way is asked to give way: set from any thread while tc_render() runs.
 *
 * Between pieces of a frame (units of pixels that take some milliseconds) tc_render() looks at both, and gives way at
 * once. Within a piece, and while it builds what frames share, it looks every few milliseconds at most: at `cancel`, and
 * whether `pause_us` has passed by TC_GRACE_US. Rays that are cut then are cast anew when the frame is resumed; what is
 * built for all frames goes on where it was.
 *
 * A call whose pause is over when it begins still does something: a piece, or TC_GRACE_US of building. Where not even that
 * brought the frame any further (one ray takes longer, or a small structure that is not kept in parts: distance map,
 * bounds, cover), the grace doubles with each such call, so that every frame is done at last. */
#ifndef TC_RENDERER_INTERRUPT_H
#define TC_RENDERER_INTERRUPT_H

#include <stdatomic.h>
#include <stdbool.h>

#define TC_GRACE_US 10000 /* what is under way when a pause begins may take so long */

typedef struct tc_interrupt {
  atomic_bool cancel;    /* give up: TC_ERROR_CANCELLED */
  atomic_llong pause_us; /* of CLOCK_MONOTONIC (g_get_monotonic_time()): from then on give way, TC_ERROR_PAUSED;
                            LLONG_MAX = never */
} tc_interrupt;

/* Asks for nothing. */
void tc_interrupt_init(tc_interrupt *interrupt);

#endif
