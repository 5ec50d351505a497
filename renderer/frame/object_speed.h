/* How fast a renderer draws objects, beside the machine that the rates of plan/object_cost.h were fitted on. Thread of
 * tc_render(). */
#ifndef TC_FRAME_OBJECT_SPEED_H
#define TC_FRAME_OBJECT_SPEED_H

#include "renderer/tomocast.h"

/* A measurement in pieces: others wait for the thread it takes. */
typedef struct tc_object_speed tc_object_speed;
tc_object_speed *tc_object_speed_new(void);
void tc_object_speed_free(tc_object_speed *speed); /* NULL is fine */

/* Draws a small object in one mode after the other for about 5 ms, and compares the least times with what the rates expect.
 * The factors that instruction set, threads and clock of this machine give each mode, once each was drawn often enough (some tens
 * of milliseconds in all; all 1 where it fails); NULL before. `renderer` is of the cpu. */
const double *tc_object_speed_go_on(tc_object_speed *speed, tc_renderer *renderer);

#endif
