/* Projections: the exact maximum, minimum or mean of the field along a ray, through the scene's window. */
#include <math.h>

#include "renderer/reference/internal.h"

static bool is_whole(const tc_ref_label_cell *label) {
  for (int corner = 0; corner < 8; corner++)
    if (label->corner[corner][4] < 1) return false;
  return true;
}

static void add_visible(tc_ref_extent *extent, const tc_ref_cell *cell) {
  enum { parts = 64 };
  for (int i = 0; i < parts; i++) {
    double u = (i + 0.5) / parts, value = 0, tint[4];
    if (tc_ref_label_mean(cell->label, u, tint) < 0.5) continue;
    for (int k = cell->degree; k >= 0; k--) value = value * u + cell->c[k];
    extent->lo = fmin(extent->lo, value);
    extent->hi = fmax(extent->hi, value);
    extent->integral += cell->length / parts * value;
    extent->length += cell->length / parts;
  }
}

void tc_ref_extent_add(tc_ref_extent *extent, const tc_ref_cell *cell) {
  if (cell->label && !is_whole(cell->label)) {
    add_visible(extent, cell);
    return;
  }
  for (int i = 0; i <= cell->degree; i++) extent->integral += cell->length * cell->c[i] / (i + 1);
  extent->length += cell->length;
  if (cell->lo >= extent->lo && cell->hi <= extent->hi) return; /* the cell cannot extend the range */
  /* Pieces are monotone, so their ends have the least and the largest value. */
  tc_ref_cutter cutter;
  tc_ref_piece piece;
  tc_ref_cutter_start(&cutter, cell, NULL, 0);
  while (tc_ref_cutter_next(&cutter, &piece)) {
    extent->lo = fmin(extent->lo, fmin(piece.front, piece.back));
    extent->hi = fmax(extent->hi, fmax(piece.front, piece.back));
  }
}

double tc_ref_window_grey(const tc_ref_window *window, double value) {
  double grey = fmin(fmax((value - window->center) / window->width + 0.5, 0), 1);
  if (!window->linear_light) return grey;
  return grey <= 0.04045 ? grey / 12.92 : pow((grey + 0.055) / 1.055, 2.4);
}
