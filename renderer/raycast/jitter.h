/* Jitter: the rays of each pixel start at a different phase, by interleaved gradient noise (Jimenez, Next Generation
 * Post Processing in Call of Duty, 2014), which is evenly distributed in every neighbourhood. Integer arithmetic, so
 * that all back ends compute the same phase: jitter_tmpl.h and jitter.glsl repeat it with these constants. */
#ifndef TC_RAYCAST_JITTER_H
#define TC_RAYCAST_JITTER_H

#include <stdint.h>

#define TC_JITTER_X 288237661u /* 0.06711056 * 2^32 */
#define TC_JITTER_Y 25070368u  /* 0.00583715 * 2^32 */
#define TC_JITTER_TIMES 53u    /* 52.9829189 = 53 - 1119 / 2^16 */
#define TC_JITTER_LESS 1119u

/* The phase of pixel (x, y): above 0, at most 1. */
static inline double tc_jitter_phase(uint32_t x, uint32_t y) {
  uint32_t inner = x * TC_JITTER_X + y * TC_JITTER_Y;
  uint32_t noise = inner * TC_JITTER_TIMES - (inner >> 16) * TC_JITTER_LESS;
  return ((noise >> 8) + 1) / 16777216.0;
}

#endif
