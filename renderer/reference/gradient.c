/* Gradients of the field over index coordinates, one function per tc_gradient. */
#include "renderer/reference/internal.h"

/* The derivative of the trilinear field. */
static void of_cell(const tc_ref_around *around, const double x[3], double g[3]) {
  for (int corner = 0; corner < 8; corner++) {
    double v = around->voxel[1 + (corner >> 2)][1 + (corner >> 1 & 1)][1 + (corner & 1)];
    for (int k = 0; k < 3; k++) {
      int a = (k + 1) % 3, b = (k + 2) % 3;
      double weight = (corner >> a & 1 ? x[a] : 1 - x[a]) * (corner >> b & 1 ? x[b] : 1 - x[b]);
      g[k] += (corner >> k & 1 ? weight : -weight) * v;
    }
  }
}

/* Voxels between the two neighbours of voxel i along an axis of n voxels: 2, or 1 at its ends. */
static int apart_at(size_t i, int n) { return (i + 1 < (size_t)n) + (i > 0); }

/* Central differences at each corner (one-sided in a face), trilinearly interpolated. */
static void of_differences(const tc_ref_field *field, const size_t low[3], const tc_ref_around *around, const double x[3], double g[3]) {
  const double *voxel = &around->voxel[0][0][0];
  static const int step[3] = {1, 4, 16};
  for (int corner = 0; corner < 8; corner++) {
    const int up[3] = {corner & 1, corner >> 1 & 1, corner >> 2};
    const double *at = voxel + (1 + up[0]) * step[0] + (1 + up[1]) * step[1] + (1 + up[2]) * step[2];
    double weight = 1;
    for (int k = 0; k < 3; k++) weight *= up[k] ? x[k] : 1 - x[k];
    if (weight == 0) continue;
    for (int k = 0; k < 3; k++) {
      const int apart = apart_at(low[k] + (size_t)up[k], field->desc->dims[k]);
      if (apart) g[k] += weight / apart * (at[step[k]] - at[-step[k]]);
    }
  }
}

/* The derivative of the cubic B-spline, one axis at a time. */
static void of_spline(const tc_ref_around *around, const double x[3], double g[3]) {
  double w[3][4], d[3][4], base = around->voxel[1][1][1];
  for (int k = 0; k < 3; k++) {
    double f = x[k], h = 1 - f;
    w[k][0] = h * h * h / 6, w[k][1] = (4 - 6 * f * f + 3 * f * f * f) / 6;
    w[k][2] = (4 - 6 * h * h + 3 * h * h * h) / 6, w[k][3] = f * f * f / 6;
    d[k][0] = -h * h / 2, d[k][1] = f * (3 * f - 4) / 2;
    d[k][2] = h * (4 - 3 * h) / 2, d[k][3] = f * f / 2;
  }
  for (int i = 0; i < 64; i++) {
    int a = i & 3, b = i >> 2 & 3, c = i >> 4;
    double v = around->voxel[c][b][a] - base;
    g[0] += v * d[0][a] * w[1][b] * w[2][c];
    g[1] += v * w[0][a] * d[1][b] * w[2][c];
    g[2] += v * w[0][a] * w[1][b] * d[2][c];
  }
}

void tc_ref_gradient(const tc_ref_field *field, tc_gradient kind, const size_t low[3], tc_ref_around *around, const double x[3],
                     double g[3]) {
  g[0] = g[1] = g[2] = 0;
  tc_ref_around_read(around, field, low);
  if (kind == TC_GRADIENT_CELL) of_cell(around, x, g);
  if (kind == TC_GRADIENT_CENTRAL) of_differences(field, low, around, x, g);
  if (kind == TC_GRADIENT_CUBIC) of_spline(around, x, g);
}
