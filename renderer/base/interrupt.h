/* Cancels or pauses a render; set from any thread while tc_render() runs.
 *
 * A frame is drawn in units of pixels that take some milliseconds each. Between two units tc_render() stops at once if
 * `cancel` is set or `pause_us` has passed. Inside a unit, and while it builds resources, it checks every few
 * milliseconds; there `cancel` stops it at once, and `pause_us` stops it TC_GRACE_US later. A ray that was stopped
 * midway is cast again when the frame is resumed; a long build of a resource continues where it stopped.
 *
 * A call whose pause time has already passed still makes progress: one unit, or TC_GRACE_US of building. This may not
 * suffice: one ray may take longer, and small resources (distance map, bounds, cover, a table's outline, integrals,
 * labels) are rebuilt from the start. The grace period therefore doubles with each such call, so that every frame is
 * finished eventually. */
#ifndef TC_RENDERER_INTERRUPT_H
#define TC_RENDERER_INTERRUPT_H

#include <stdatomic.h>
#include <stdbool.h>

#define TC_GRACE_US 10000 /* how long after the pause time work in progress may continue */

typedef struct tc_interrupt {
  atomic_bool cancel;    /* stop: TC_ERROR_CANCELLED */
  atomic_llong pause_us; /* pause at this time, CLOCK_MONOTONIC (g_get_monotonic_time()): TC_ERROR_PAUSED; LLONG_MAX =
                            never */
} tc_interrupt;

/* Neither cancelled nor paused. */
void tc_interrupt_init(tc_interrupt *interrupt);

#endif
