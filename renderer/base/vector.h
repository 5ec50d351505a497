/* Vectors of three doubles. */
#ifndef TC_VECTOR_H
#define TC_VECTOR_H

#include <math.h>
#include <stdbool.h>

static inline double dot3(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void cross3(const double a[3], const double b[3], double c[3]) {
  c[0] = a[1] * b[2] - a[2] * b[1];
  c[1] = a[2] * b[0] - a[0] * b[2];
  c[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double length3(const double v[3]) { return sqrt(dot3(v, v)); }

static inline void normalise3(double v[3]) {
  const double length = length3(v);
  for (int k = 0; k < 3; k++) v[k] /= length;
}

static inline bool finite3(const double v[3]) { return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]); }

#endif
