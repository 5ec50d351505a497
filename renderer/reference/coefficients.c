/* B-spline coefficients, so that the cubic field passes through the voxels: along each axis the tridiagonal system
 * (c[i-1] + 4 c[i] + c[i+1]) / 6 = v[i], with c[-1] = c[0] and c[n] = c[n-1], by elimination. */
#include <glib.h>

#include "renderer/reference/internal.h"

/* One line of n values, `stride` apart; upper[n] is scratch. */
static void solve_line(double *line, size_t n, size_t stride, double *upper) {
  for (size_t i = 0; i < n; i++) {
    double *v = line + i * stride, diagonal = 4 + (i == 0) + (i == n - 1);
    double pivot = diagonal - (i ? upper[i - 1] : 0);
    upper[i] = 1 / pivot;
    *v = (6 * *v - (i ? v[-(ptrdiff_t)stride] : 0)) / pivot;
  }
  for (size_t i = n - 1; i-- > 0;) line[i * stride] -= upper[i] * line[(i + 1) * stride];
}

/* *cancel is polled once per this many voxels. */
#define STRETCH 65536

static bool stop_at(size_t i, const atomic_bool *cancel) {
  return cancel && i % STRETCH == 0 && atomic_load_explicit(cancel, memory_order_relaxed);
}

double *tc_ref_coefficients(const tc_ref_field *field, const atomic_bool *cancel) {
  const int *dims = field->desc->dims;
  size_t n[3], stride[3], count = 1;
  for (int k = 0; k < 3; k++) {
    n[k] = (size_t)dims[k];
    stride[k] = count;
    count *= n[k];
  }
  double *c = g_try_new(double, count), *upper = g_try_new(double, MAX(n[0], MAX(n[1], n[2])));
  if (!c || !upper) {
    g_free(c);
    g_free(upper);
    return NULL;
  }
  for (size_t i = 0; i < count && !stop_at(i, cancel); i++)
    c[i] = tc_ref_voxel(field, (size_t[3]){i % n[0], i / n[0] % n[1], i / n[0] / n[1]});
  for (int k = 0; k < 3; k++)
    for (size_t i = 0; i < count && !stop_at(i, cancel); i++)
      if (i / stride[k] % n[k] == 0) solve_line(c + i, n[k], stride[k], upper);
  g_free(upper);
  return c;
}
