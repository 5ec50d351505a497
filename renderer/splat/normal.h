/* Unit vectors in few bits: the sphere as an octahedron unfolded to a square (Cigolla et al., A survey of efficient
 * representations for independent unit vectors, JCGT 3(2), 2014). */
#ifndef TC_SPLAT_NORMAL_H
#define TC_SPLAT_NORMAL_H

#include <math.h>
#include <stdint.h>

/* Each coordinate in 0 .. 2 half: the axes are exact. A zero vector becomes +z. */
static inline void tc_octahedron_fold(const double v[3], int half, int folded[2]) {
  double sum = fabs(v[0]) + fabs(v[1]) + fabs(v[2]), p[2] = {0, 0};
  if (sum > 0) p[0] = v[0] / sum, p[1] = v[1] / sum;
  if (v[2] < 0) {
    double x = p[0];
    p[0] = copysign(1 - fabs(p[1]), x);
    p[1] = copysign(1 - fabs(x), p[1]);
  }
  for (int k = 0; k < 2; k++)
    folded[k] = half + (int)lround(p[k] * half);
}

static inline void tc_octahedron_unfold(int a, int b, int half, float n[3]) {
  float x = (float)(a - half) / (float)half, y = (float)(b - half) / (float)half, z = 1 - fabsf(x) - fabsf(y);
  if (z < 0) {
    float t = x;
    x = copysignf(1 - fabsf(y), t);
    y = copysignf(1 - fabsf(t), y);
  }
  float scale = 1 / sqrtf(x * x + y * y + z * z);
  n[0] = x * scale, n[1] = y * scale, n[2] = z * scale;
}

/* The two bytes of attribute "normal": coordinates 0 .. 254, x in the low byte. */
static inline uint16_t tc_normal_pack(const double v[3]) {
  int folded[2];
  tc_octahedron_fold(v, 127, folded);
  return (uint16_t)(folded[0] | folded[1] << 8);
}

#endif
