#include "renderer/mesh/deviation.h"

#include <math.h>
#include <stdlib.h>

#define MOST_CELLS 64 /* along an axis */

/* One instruction each; no number is NaN here but a quotient's, which is then not taken. */
static inline float lesser(float a, float b) { return b < a ? b : a; }
static inline float greater(float a, float b) { return b > a ? b : a; }

struct tc_deviation {
  const float (*positions)[3];
  const uint32_t *triangles;
  size_t n;
  float lo[3], cell; /* its width */
  int cells[3];
  uint32_t *first, *list; /* of a cell: list[first[c]] .. list[first[c + 1]] */
};

static float dot(const float a[3], const float b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

/* Squared, from a point to a segment. */
static float to_segment(const float p[3], const float a[3], const float b[3]) {
  float along[3], to[3], square = 0;
  for (int k = 0; k < 3; k++) along[k] = b[k] - a[k], to[k] = p[k] - a[k];
  const float length = dot(along, along), t = length > 0 ? lesser(greater(dot(to, along) / length, 0), 1) : 0;
  for (int k = 0; k < 3; k++) square += (to[k] - t * along[k]) * (to[k] - t * along[k]);
  return square;
}

/* Squared, from a point to a triangle: to its plane where the foot is within it, else to the nearest edge. */
static float to_triangle(const float p[3], const float a[3], const float b[3], const float c[3]) {
  float u[3], v[3], w[3];
  for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], v[k] = c[k] - a[k], w[k] = p[k] - a[k];
  const float uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), wu = dot(w, u), wv = dot(w, v);
  const float det = uu * vv - uv * uv, s = (vv * wu - uv * wv) / det, t = (uu * wv - uv * wu) / det;
  if (det > 0 && s >= 0 && t >= 0 && s + t <= 1) {
    float square = 0;
    for (int k = 0; k < 3; k++) square += (w[k] - s * u[k] - t * v[k]) * (w[k] - s * u[k] - t * v[k]);
    return square;
  }
  return lesser(to_segment(p, a, b), lesser(to_segment(p, b, c), to_segment(p, c, a)));
}

static const float *corner(const tc_deviation *d, uint32_t triangle, int i) {
  return d->positions[d->triangles[3 * (size_t)triangle + (size_t)i]];
}

/* Cells that a triangle's box touches. */
static void range_of(const tc_deviation *d, uint32_t t, int lo[3], int hi[3]) {
  for (int k = 0; k < 3; k++) {
    const float a = corner(d, t, 0)[k], b = corner(d, t, 1)[k], c = corner(d, t, 2)[k];
    const float least = lesser(a, lesser(b, c)), most = greater(a, greater(b, c));
    lo[k] = (int)lesser((least - d->lo[k]) / d->cell, (float)(d->cells[k] - 1));
    hi[k] = (int)lesser((most - d->lo[k]) / d->cell, (float)(d->cells[k] - 1));
  }
}

/* Counts, or with a list puts, each triangle into its cells. */
static void enter_all(tc_deviation *d) {
  for (uint32_t t = 0; t < d->n; t++) {
    int lo[3], hi[3];
    range_of(d, t, lo, hi);
    for (int z = lo[2]; z <= hi[2]; z++)
      for (int y = lo[1]; y <= hi[1]; y++)
        for (int x = lo[0]; x <= hi[0]; x++) {
          uint32_t *at = &d->first[(z * d->cells[1] + y) * d->cells[0] + x];
          if (d->list) d->list[--*at] = t;
          else ++*at;
        }
  }
}

/* Cells about as wide as a triangle. */
static void set_grid(tc_deviation *d) {
  float hi[3], longest = 0;
  double size = 0;
  for (int k = 0; k < 3; k++) d->lo[k] = INFINITY, hi[k] = -INFINITY;
  for (uint32_t t = 0; t < d->n; t++)
    for (int k = 0; k < 3; k++) {
      for (int i = 0; i < 3; i++) d->lo[k] = lesser(d->lo[k], corner(d, t, i)[k]), hi[k] = greater(hi[k], corner(d, t, i)[k]);
      size += fabs((double)corner(d, t, 1)[k] - (double)corner(d, t, 0)[k]);
    }
  for (int k = 0; k < 3; k++) longest = greater(longest, hi[k] - d->lo[k]);
  d->cell = greater((float)(size / (double)d->n), greater(longest / (MOST_CELLS - 1), 1e-30f));
  for (int k = 0; k < 3; k++) d->cells[k] = 1 + (int)((hi[k] - d->lo[k]) / d->cell);
}

tc_deviation *tc_deviation_begin(const float (*positions)[3], const uint32_t *triangles, size_t n_triangles) {
  tc_deviation *d = n_triangles ? calloc(1, sizeof *d) : NULL;
  if (!d) return NULL;
  *d = (tc_deviation){.positions = positions, .triangles = triangles, .n = n_triangles};
  set_grid(d);
  const size_t n = (size_t)d->cells[0] * (size_t)d->cells[1] * (size_t)d->cells[2];
  d->first = calloc(n + 1, sizeof *d->first);
  if (d->first) enter_all(d);
  for (size_t i = 1; d->first && i <= n; i++) d->first[i] += d->first[i - 1];
  d->list = d->first ? malloc((d->first[n] + 1) * sizeof *d->list) : NULL;
  if (d->list) {
    enter_all(d);
    return d;
  }
  tc_deviation_end(d);
  return NULL;
}

/* The least square in the cells that are `ring` cells from the point's, or one that is at most `enough`. */
static float in_ring(const tc_deviation *d, const float p[3], const int at[3], int ring, float least, float enough) {
  int lo[3], hi[3];
  for (int k = 0; k < 3; k++) {
    lo[k] = at[k] - ring > 0 ? at[k] - ring : 0;
    hi[k] = at[k] + ring < d->cells[k] - 1 ? at[k] + ring : d->cells[k] - 1;
  }
  for (int z = lo[2]; z <= hi[2]; z++)
    for (int y = lo[1]; y <= hi[1]; y++)
      for (int x = lo[0]; x <= hi[0]; x++) {
        const bool on = abs(x - at[0]) == ring || abs(y - at[1]) == ring || abs(z - at[2]) == ring;
        const uint32_t *first = &d->first[(z * d->cells[1] + y) * d->cells[0] + x];
        for (uint32_t i = on ? first[0] : first[1]; i < first[1] && least > enough; i++)
          least = lesser(least, to_triangle(p, corner(d, d->list[i], 0), corner(d, d->list[i], 1), corner(d, d->list[i], 2)));
      }
  return least;
}

float tc_deviation_at(const tc_deviation *d, const float p[3], float enough) {
  int at[3];
  float least = INFINITY, within = INFINITY; /* to the walls of the point's own cell; below 0 outside the grid */
  for (int k = 0; k < 3; k++) {
    at[k] = (int)lesser(greater((p[k] - d->lo[k]) / d->cell, 0), (float)(d->cells[k] - 1));
    const float from = p[k] - d->lo[k] - (float)at[k] * d->cell;
    within = lesser(within, lesser(from, d->cell - from));
  }
  for (int ring = 0; ring < MOST_CELLS; ring++) {
    least = in_ring(d, p, at, ring, least, enough * enough);
    if (least <= enough * enough) break;
    const float clear = within + (float)ring * d->cell; /* nothing beyond the ring is nearer */
    if (clear > 0 && least <= clear * clear) break;
  }
  return sqrtf(least);
}

void tc_deviation_end(tc_deviation *d) {
  if (!d) return;
  free(d->first);
  free(d->list);
  free(d);
}
