/* Cancels or pauses a render: set from any thread while tc_render() runs.
 *
 * tc_render() checks `cancel` and `pause_us` between units of pixels, which take some milliseconds, and stops at once.
 * Within a unit, and while it builds resources, it checks every few milliseconds: `cancel`, and whether `pause_us` passed
 * TC_GRACE_US ago. Rays that are stopped then are cast again when the frame is resumed; resources are built further from
 * where they were.
 *
 * A call whose pause time is already past when it begins still makes progress: a unit, or TC_GRACE_US of building. Where
 * that was not enough (one ray takes longer, or a small resource that is not kept in parts: distance map, bounds, cover,
 * a table's outline, integrals, labels), the grace doubles with each such call, so that every frame is done in the end. */
#ifndef TC_RENDERER_INTERRUPT_H
#define TC_RENDERER_INTERRUPT_H

#include <stdatomic.h>
#include <stdbool.h>

#define TC_GRACE_US 10000 /* work under way when a pause begins may take this long */

typedef struct tc_interrupt {
  atomic_bool cancel;    /* stop: TC_ERROR_CANCELLED */
  atomic_llong pause_us; /* time of CLOCK_MONOTONIC (g_get_monotonic_time()) from which on to stop: TC_ERROR_PAUSED;
                            LLONG_MAX = never */
} tc_interrupt;

/* Neither cancelled nor paused. */
void tc_interrupt_init(tc_interrupt *interrupt);

#endif
