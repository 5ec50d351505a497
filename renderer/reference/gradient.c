/* Gradients of the field over index coordinates, one function per tc_gradient. */
#include <math.h>

#include "renderer/reference/internal.h"

/* The voxel at low + (x, y, z), clamped to the volume. */
static double voxel_near(const tc_ref_field *field, const size_t low[3], int x, int y, int z) {
  const int step[3] = {x, y, z};
  size_t at[3];
  for (int k = 0; k < 3; k++) at[k] = (size_t)fmin(fmax((double)low[k] + step[k], 0), field->desc->dims[k] - 1);
  return tc_ref_voxel(field, at);
}

/* The derivative of the trilinear field. */
static void of_cell(const tc_ref_field *field, const size_t low[3], const double x[3], double g[3]) {
  for (int corner = 0; corner < 8; corner++) {
    double v = voxel_near(field, low, corner & 1, corner >> 1 & 1, corner >> 2);
    for (int k = 0; k < 3; k++) {
      int a = (k + 1) % 3, b = (k + 2) % 3;
      double weight = (corner >> a & 1 ? x[a] : 1 - x[a]) * (corner >> b & 1 ? x[b] : 1 - x[b]);
      g[k] += (corner >> k & 1 ? weight : -weight) * v;
    }
  }
}

/* Central differences at each corner (one-sided in a face), trilinearly interpolated. */
static void of_differences(const tc_ref_field *field, const size_t low[3], const double x[3], double g[3]) {
  for (int corner = 0; corner < 8; corner++) {
    const int up[3] = {corner & 1, corner >> 1 & 1, corner >> 2};
    double weight = 1;
    for (int k = 0; k < 3; k++) weight *= up[k] ? x[k] : 1 - x[k];
    if (weight == 0) continue;
    for (int k = 0; k < 3; k++) {
      const int e[3] = {k == 0, k == 1, k == 2};
      double i = (double)low[k] + up[k], apart = fmin(i + 1, field->desc->dims[k] - 1) - fmax(i - 1, 0);
      if (!(apart > 0)) continue;
      g[k] += weight / apart * (voxel_near(field, low, up[0] + e[0], up[1] + e[1], up[2] + e[2]) -
                                voxel_near(field, low, up[0] - e[0], up[1] - e[1], up[2] - e[2]));
    }
  }
}

/* The derivative of the cubic B-spline, one axis at a time. */
static void of_spline(const tc_ref_field *field, const size_t low[3], const double x[3], double g[3]) {
  double w[3][4], d[3][4], base = tc_ref_voxel(field, low);
  for (int k = 0; k < 3; k++) {
    double f = x[k], h = 1 - f;
    w[k][0] = h * h * h / 6, w[k][1] = (4 - 6 * f * f + 3 * f * f * f) / 6;
    w[k][2] = (4 - 6 * h * h + 3 * h * h * h) / 6, w[k][3] = f * f * f / 6;
    d[k][0] = -h * h / 2, d[k][1] = f * (3 * f - 4) / 2;
    d[k][2] = h * (4 - 3 * h) / 2, d[k][3] = f * f / 2;
  }
  for (int i = 0; i < 64; i++) {
    int a = i & 3, b = i >> 2 & 3, c = i >> 4;
    double v = voxel_near(field, low, a - 1, b - 1, c - 1) - base;
    g[0] += v * d[0][a] * w[1][b] * w[2][c];
    g[1] += v * w[0][a] * d[1][b] * w[2][c];
    g[2] += v * w[0][a] * w[1][b] * d[2][c];
  }
}

void tc_ref_gradient(const tc_ref_field *field, tc_gradient kind, const size_t low[3], const double x[3], double g[3]) {
  g[0] = g[1] = g[2] = 0;
  if (kind == TC_GRADIENT_CELL) of_cell(field, low, x, g);
  if (kind == TC_GRADIENT_CENTRAL) of_differences(field, low, x, g);
  if (kind == TC_GRADIENT_CUBIC) of_spline(field, low, x, g);
}
