/* Speed of this machine at drawing solid objects, relative to the machine on which the rates of plan/object_cost.h were
 * fitted. Thread of tc_render(). */
#ifndef TC_FRAME_OBJECT_SPEED_H
#define TC_FRAME_OBJECT_SPEED_H

#include "renderer/tomocast.h"

/* A measurement in small steps, because other clients wait for the render thread. */
typedef struct tc_object_speed tc_object_speed;
tc_object_speed *tc_object_speed_new(void);
void tc_object_speed_free(tc_object_speed *speed); /* NULL is fine */

/* Draws a small object for about 5 ms, in one mode per call. Returns NULL until each mode was drawn often enough (some
 * tens of milliseconds in all), then [TC_OBJECT_MODES] factors: shortest measured time over the time that the rates
 * predict; all 1 if measuring failed. Owned by `speed`. `renderer` is a cpu renderer. */
const double *tc_object_speed_go_on(tc_object_speed *speed, tc_renderer *renderer);

#endif
