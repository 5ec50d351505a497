/* Isosurfaces: where the field along a ray first changes sides, and the normal there. */
#include <math.h>
#include <string.h>

#include "renderer/reference/internal.h"

/* Pieces are monotone and reach the value only at their ends, so a change of side lies at the front end of a piece. */
static bool changes_at(const tc_ref_piece *piece, double value, bool inside) {
  return (piece->front >= value) != inside || (inside && piece->back < value);
}

/* A cell with a gap among its corners has no surface. */
static bool is_blank(const tc_ref_field *field, const size_t low[3]) {
  bool blank = false;
  for (int corner = 0; corner < 8 && field->gaps; corner++) {
    size_t at[3];
    for (int k = 0; k < 3; k++) at[k] = low[k] + (low[k] + 1 < (size_t)field->desc->dims[k] && corner >> k & 1);
    blank |= field->gaps[(at[2] * (size_t)field->desc->dims[1] + at[1]) * (size_t)field->desc->dims[0] + at[0]] != 0;
  }
  return blank;
}

bool tc_ref_surface_hit(const tc_ref_field *field, const tc_ref_ray *ray, double value, int skip, bool *leaves, double *t) {
  tc_ref_walk walk;
  tc_ref_cell cell;
  bool inside = false, known = false;
  tc_ref_walk_start(&walk, field, ray);
  while (tc_ref_walk_next(&walk, &cell)) {
    if (is_blank(field, cell.low)) {
      known = false;
      continue;
    }
    if (known && (inside ? cell.lo >= value : cell.hi < value)) continue;
    tc_ref_cutter cutter;
    tc_ref_piece piece;
    tc_ref_cutter_start(&cutter, &cell, &value, 1);
    while (tc_ref_cutter_next(&cutter, &piece)) {
      if (!known) inside = piece.front >= value, known = true;
      if (!changes_at(&piece, value, inside)) continue;
      *leaves = inside;
      inside = !inside;
      if (skip-- > 0) continue;
      *t = cell.from + piece.from * cell.length;
      return true;
    }
  }
  return false;
}

static void find_cell(const tc_ref_field *field, const double at[3], size_t low[3], double f[3]) {
  for (int k = 0; k < 3; k++) {
    low[k] = (size_t)fmax(fmin(floor(at[k]), field->desc->dims[k] - 2), 0);
    f[k] = at[k] - (double)low[k];
  }
}

static double value_at(const tc_ref_field *field, const double at[3]) {
  double sum = 0, f[3];
  size_t low[3];
  find_cell(field, at, low, f);
  for (int corner = 0; corner < 8; corner++) {
    double weight = 1;
    size_t index[3];
    for (int k = 0; k < 3; k++) {
      bool high = corner >> k & 1;
      weight *= high ? f[k] : 1 - f[k];
      index[k] = low[k] + high;
    }
    if (weight != 0) sum += weight * tc_ref_voxel(field, index);
  }
  return sum;
}

bool tc_ref_value_at(const tc_ref_field *field, const double at[3], double *value) {
  double held[3], f[3];
  size_t low[3];
  for (int k = 0; k < 3; k++) held[k] = fmin(fmax(at[k], 0), field->desc->dims[k] - 1);
  find_cell(field, held, low, f);
  *value = value_at(field, held);
  return !is_blank(field, low);
}

void tc_ref_surface_gradient(const tc_ref_field *field, tc_gradient kind, const double at[3], double gradient[3]) {
  double apart[3];
  if (kind != TC_GRADIENT_CELL) {
    double held[3], f[3];
    size_t low[3];
    tc_ref_around around = {0};
    for (int k = 0; k < 3; k++) held[k] = fmin(fmax(at[k], 0), field->desc->dims[k] - 1);
    find_cell(field, held, low, f);
    tc_ref_gradient(field, kind, low, &around, f, gradient);
    return;
  }
  for (int k = 0; k < 3; k++) {
    double last = field->desc->dims[k] - 1;
    apart[k] = fmin(at[k] + 1, last) - fmax(at[k] - 1, 0);
    gradient[k] = 0;
  }
  for (int corner = 0; corner < 8; corner++) {
    double place[3];
    for (int k = 0; k < 3; k++) place[k] = fmin(fmax(at[k] + (corner >> k & 1 ? 1 : -1), 0), field->desc->dims[k] - 1);
    double value = value_at(field, place);
    for (int k = 0; k < 3; k++)
      if (apart[k] > 0) gradient[k] += (corner >> k & 1 ? value : -value) / (4 * apart[k]);
  }
}
