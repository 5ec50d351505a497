/* How fast a renderer draws objects, beside the machine that the rates of plan/object_cost.h were fitted on. */
#ifndef TC_FRAME_OBJECT_SPEED_H
#define TC_FRAME_OBJECT_SPEED_H

#include "renderer/tomocast.h"

/* Draws a small object in each mode some times, and compares the least time with what the rates expect of it: the factors
 * that instruction set, threads and clock of this machine give each mode. Some tens of milliseconds; all 1 where it fails.
 * Thread of tc_render(). */
void tc_object_speed_measure(tc_renderer *renderer, double speed[TC_OBJECT_MODES]);

#endif
