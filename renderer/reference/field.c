/* The field along a ray, as an exact polynomial per cell: of degree 3 for trilinear, 9 for the tricubic B-spline,
 * and constant for the nearest voxel. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "renderer/reference/internal.h"

double tc_ref_voxel(const tc_ref_field *field, const size_t at[3]) {
  const tc_volume_desc *desc = field->desc;
  size_t i = (at[2] * (size_t)desc->dims[1] + at[1]) * (size_t)desc->dims[0] + at[0];
  double v = 0;
  if (field->coefficients) return field->coefficients[i];
  if (field->smooth) return tc_ref_smooth_at(field->smooth, at);
  switch (desc->type) {
  case TC_U8: v = ((const uint8_t *)field->voxels)[i]; break;
  case TC_I8: v = ((const int8_t *)field->voxels)[i]; break;
  case TC_U16: v = ((const uint16_t *)field->voxels)[i]; break;
  case TC_I16: v = ((const int16_t *)field->voxels)[i]; break;
  case TC_F32: v = (double)((const float *)field->voxels)[i]; break;
  case TC_VOXEL_TYPE_COUNT: break;
  }
  return desc->slope * v + desc->intercept;
}

void tc_ref_around_read(tc_ref_around *around, const tc_ref_field *field, const size_t low[3]) {
  size_t at[3][4];
  if (around->read) return;
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < 4; i++) {
      const size_t last = (size_t)field->desc->dims[k] - 1, next = low[k] + (size_t)i;
      at[k][i] = next < 1 ? 0 : next - 1 < last ? next - 1 : last;
    }
  for (int i = 0; i < 64; i++)
    around->voxel[i >> 4][i >> 2 & 3][i & 3] = tc_ref_voxel(field, (size_t[3]){at[0][i & 3], at[1][i >> 2 & 3], at[2][i >> 4]});
  around->read = true;
}

/* Distance between the planes at which a walk stops. */
static double plane_distance(const tc_ref_field *field) { return field->filter == TC_FILTER_NEAREST ? 0.5 : 1; }

void tc_ref_walk_start(tc_ref_walk *walk, const tc_ref_field *field, const tc_ref_ray *ray) {
  walk->field = field;
  walk->ray = ray;
  walk->t = ray->enter;
  for (int k = 0; k < 3; k++)
    walk->plane[k] = floor(ray->origin[k] + ray->enter * ray->direction[k]) + (ray->direction[k] < 0);
}

/* The t of the next face of any axis after walk->t. Planes are counted, and each has a t of its own, so that no
 * error accumulates along a ray. */
static double next_face(tc_ref_walk *walk) {
  const tc_ref_ray *ray = walk->ray;
  double next = ray->leave;
  for (int k = 0; k < 3; k++) {
    double d = ray->direction[k];
    if (d == 0 || walk->field->desc->dims[k] == 1) continue;
    double at = (walk->plane[k] - ray->origin[k]) / d;
    while (at <= walk->t) {
      walk->plane[k] += copysign(plane_distance(walk->field), d);
      double then = (walk->plane[k] - ray->origin[k]) / d;
      if (!(then > at)) return next; /* double cannot resolve the planes: the ray is as good as parallel to them */
      at = then;
    }
    next = fmin(next, at);
  }
  return next;
}

/* The cell that contains the middle of the stretch; position within it = start + u * delta. */
static void locate(const tc_ref_walk *walk, double to, size_t low[3], size_t high[3], double start[3],
                   double delta[3]) {
  const tc_ref_ray *ray = walk->ray;
  for (int k = 0; k < 3; k++) {
    int n = walk->field->desc->dims[k];
    low[k] = high[k] = 0;
    start[k] = delta[k] = 0;
    if (n == 1) continue;
    double middle = ray->origin[k] + 0.5 * (walk->t + to) * ray->direction[k];
    double i = fmin(fmax(floor(middle), 0), n - 2);
    low[k] = (size_t)i;
    high[k] = low[k] + 1;
    start[k] = ray->origin[k] - i + walk->t * ray->direction[k];
    delta[k] = (to - walk->t) * ray->direction[k];
  }
}

/* The voxel nearest to the middle of the stretch, of two equally near ones the upper. */
static void make_nearest(tc_ref_cell *cell) {
  int nearest = 0;
  for (int k = 0; k < 3; k++)
    if (cell->start[k] + 0.5 * cell->delta[k] >= 0.5 - 1e-9) nearest |= 1 << k;
  cell->degree = 0;
  cell->c[0] = cell->lo = cell->hi = cell->corner[nearest];
}

/* The four weights of the cubic B-spline at start + u * delta, as Taylor polynomials in u. */
static void spline_weights(double start, double delta, double w[4][4]) {
  static const double basis[4][4] = {{1, -3, 3, -1}, {4, 0, -6, 3}, {1, 3, 3, -3}, {0, 0, 0, 1}}; /* sixths */
  for (int i = 0; i < 4; i++) {
    const double *b = basis[i];
    w[i][0] = (b[0] + start * (b[1] + start * (b[2] + start * b[3]))) / 6;
    w[i][1] = delta * (b[1] + start * (2 * b[2] + start * 3 * b[3])) / 6;
    w[i][2] = delta * delta * (b[2] + 3 * start * b[3]) / 6;
    w[i][3] = delta * delta * delta * b[3] / 6;
  }
}

/* to[] += a * b, polynomials of degrees n and 3. */
static void add_product(double *to, const double *a, int n, const double b[4]) {
  for (int i = 0; i <= n; i++)
    for (int j = 0; j < 4; j++) to[i + j] += a[i] * b[j];
}

/* Sums differences to one voxel, so that equal voxels give an exactly constant field. */
static void make_cubic(tc_ref_cell *cell) {
  tc_ref_around_read(cell->around, cell->field, cell->low);
  const tc_ref_around *around = cell->around;
  double w[3][4][4], base = around->voxel[1][1][1], cube[TC_REF_DEGREE + 1] = {0};
  for (int k = 0; k < 3; k++) spline_weights(cell->start[k], cell->delta[k], w[k]);
  for (int z = 0; z < 4; z++) {
    double plane[7] = {0};
    for (int y = 0; y < 4; y++) {
      double row[4] = {0};
      for (int x = 0; x < 4; x++) {
        double v = around->voxel[z][y][x];
        cell->lo = fmin(cell->lo, v);
        cell->hi = fmax(cell->hi, v);
        for (int i = 0; i < 4; i++) row[i] += (v - base) * w[0][x][i];
      }
      add_product(plane, row, 3, w[1][y]);
    }
    add_product(cube, plane, 6, w[2][z]);
  }
  memcpy(cell->c, cube, sizeof cube);
  cell->c[0] += base;
  cell->degree = TC_REF_DEGREE;
}

bool tc_ref_walk_next(tc_ref_walk *walk, tc_ref_cell *cell) {
  if (!(walk->t < walk->ray->leave)) return false;
  double to = next_face(walk), *start = cell->start, *delta = cell->delta;
  size_t *low = cell->low, high[3];
  locate(walk, to, low, high, start, delta);
  cell->field = walk->field;
  cell->around = &walk->around;
  walk->around.read = false;
  cell->from = walk->t;
  cell->length = to - walk->t;
  walk->t = to;

  /* Interpolates along x (p[zy]: degree 1), then y (q: degree 2), then z (the cubic), as polynomials in u.
   * Differences first, so that equal corners give an exactly constant field. */
  double p[4][2], q[2][3];
  const int side = walk->field->smooth ? tc_ref_smooth_side(walk->field->smooth, low) : 0;
  cell->lo = INFINITY;
  cell->hi = -INFINITY;
  for (int zy = 0; zy < 4; zy++) {
    size_t y = zy & 1 ? high[1] : low[1], z = zy & 2 ? high[2] : low[2];
    double a = side ? side : tc_ref_voxel(walk->field, (size_t[3]){low[0], y, z});
    double b = side ? side : tc_ref_voxel(walk->field, (size_t[3]){high[0], y, z});
    cell->lo = fmin(cell->lo, fmin(a, b));
    cell->hi = fmax(cell->hi, fmax(a, b));
    cell->corner[2 * zy] = a;
    cell->corner[2 * zy + 1] = b;
    p[zy][0] = a + (b - a) * start[0];
    p[zy][1] = (b - a) * delta[0];
  }
  for (int z = 0; z < 2; z++) {
    double d0 = p[2 * z + 1][0] - p[2 * z][0], d1 = p[2 * z + 1][1] - p[2 * z][1];
    q[z][0] = p[2 * z][0] + d0 * start[1];
    q[z][1] = p[2 * z][1] + d1 * start[1] + d0 * delta[1];
    q[z][2] = d1 * delta[1];
  }
  double d0 = q[1][0] - q[0][0], d1 = q[1][1] - q[0][1], d2 = q[1][2] - q[0][2];
  cell->c[0] = q[0][0] + d0 * start[2];
  cell->c[1] = q[0][1] + d1 * start[2] + d0 * delta[2];
  cell->c[2] = q[0][2] + d2 * start[2] + d1 * delta[2];
  cell->c[3] = d2 * delta[2];
  cell->degree = 3;
  if (walk->field->filter == TC_FILTER_NEAREST) make_nearest(cell);
  if (walk->field->filter == TC_FILTER_CUBIC) make_cubic(cell);
  cell->label = NULL;
  return true;
}

bool tc_ref_walk_bound(const tc_ref_field *field, const tc_ref_ray *ray, double *t) {
  tc_ref_walk walk;
  size_t low[3], high[3];
  double start[3], delta[3];
  tc_ref_walk_start(&walk, field, ray);
  while (walk.t < ray->leave) {
    const double to = next_face(&walk);
    locate(&walk, to, low, high, start, delta);
    *t = walk.t, walk.t = to;
    if (!tc_ref_smooth_side(field->smooth, low)) return true;
  }
  return false;
}
