/* The rays of one pixel (paper 000, section 2.9): where they go through it and where their samples lie, the same for
 * every back end.
 *
 * Of R rays each takes samples R steps apart, a different step of the R each, so that together they sample as densely
 * as one ray would and cost no more; going through different points of the pixel they smooth edges by the way. Their
 * colours and opacities are averaged. */
#ifndef TC_RAYCAST_SUBPIXEL_H
#define TC_RAYCAST_SUBPIXEL_H

#include <stdint.h>

typedef struct tc_subpixel {
  double x, y;  /* pixels from the pixel's centre, to the right and down; within -0.5 .. 0.5 */
  /* length of the ray's first segment in segments, above 0 and at most 1: the rest follow at full length */
  double phase;
} tc_subpixel;

/* rays[count], count 1..64. One ray is the centre's. More lie symmetrically about it, each in a column of its own
 * (rooks), the rows following the golden ratio, which spreads them evenly in every direction; each of the phases 1/R ..
 * 1 occurs once. */
void tc_subpixel_rays(int count, tc_subpixel *rays);

/* A phase above 0 and at most 1 for pixel (x, y), from nothing but its place: interleaved gradient noise (Jimenez, Next
 * Generation Post Processing in Call of Duty, 2014), whose values are spread evenly in every neighbourhood. In whole
 * numbers, so that all back ends have the same. Kernels and shaders repeat it with these constants. */
double tc_jitter_phase(uint32_t x, uint32_t y);

#define TC_JITTER_X 288237661u /* 0.06711056 * 2^32 */
#define TC_JITTER_Y 25070368u  /* 0.00583715 * 2^32 */
#define TC_JITTER_TIMES 53u    /* 52.9829189 = 53 - 1119 / 2^16 */
#define TC_JITTER_LESS 1119u

#endif
