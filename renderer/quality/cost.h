/* What a frame costs: milliseconds per pixel = a + b / step, fitted to frames that were rendered, later ones counting
 * more. a is what a ray costs before its first sample; while all frames had one step it is taken as a fixed share.
 * Belongs to one look on one machine. Plain data: zero-initialise; any thread, one at a time. */
#ifndef TC_QUALITY_COST_H
#define TC_QUALITY_COST_H

typedef struct tc_quality_cost {
  double w, x, xx, y, xy; /* weighted sums; x = 1 / step, y = ms per pixel, weights relative to y */
} tc_quality_cost;

/* Takes in a frame. */
void tc_quality_cost_add(tc_quality_cost *cost, double pixels, double step, double ms);
/* Expected milliseconds; 0 while nothing is known. */
double tc_quality_cost_ms(const tc_quality_cost *cost, double pixels, double step);
/* The finest step (a rung of 2^(1/8) voxels, 1/8 .. 4) expected to take at most `ms`; the coarsest where none does, 1
 * while nothing is known. */
double tc_quality_cost_step(const tc_quality_cost *cost, double pixels, double ms);

#endif
