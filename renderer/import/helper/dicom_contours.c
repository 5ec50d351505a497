#include "renderer/import/helper/dicom_contours.h"

#include <math.h>
#include <string.h>

enum { PIXELS_ACROSS = 508 }; /* width of a grid made from the contours, pixels */

#define SAME_PLANE 1e-3 /* of a layer's thickness */

static const double *corner_of(const tc_dicom_contours *c, const tc_dicom_contour *contour, size_t i) {
  return c->corners + 3 * (contour->first + i % contour->count);
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static void cross(const double a[3], const double b[3], double out[3]) {
  for (int i = 0; i < 3; i++) out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static bool normalise(double v[3]) {
  const double length = sqrt(dot(v, v));
  for (int i = 0; i < 3 && length > 0; i++) v[i] /= length;
  return length > 0;
}

/* ---- a grid of their own ---- */

/* Unit normal of a contour's plane, by Newell's method. */
static bool normal_of(const tc_dicom_contours *c, const tc_dicom_contour *contour, double normal[3]) {
  memset(normal, 0, 3 * sizeof *normal);
  for (size_t i = 0; i < contour->count; i++) {
    double a[3], b[3], area[3];
    for (int k = 0; k < 3; k++) {
      a[k] = corner_of(c, contour, i)[k] - corner_of(c, contour, 0)[k];
      b[k] = corner_of(c, contour, i + 1)[k] - corner_of(c, contour, 0)[k];
    }
    cross(a, b, area);
    for (int k = 0; k < 3; k++) normal[k] += area[k];
  }
  return normalise(normal);
}

/* Aligns rows and columns with the patient's axes as closely as the planes allow. */
static bool find_axes(const tc_dicom_contours *c, double axes[3][3]) {
  size_t i = 0;
  while (i < c->count && !normal_of(c, &c->list[i], axes[2])) i++;
  if (i == c->count) return false;
  int most = 0;
  for (int k = 1; k < 3; k++)
    if (fabs(axes[2][k]) > fabs(axes[2][most])) most = k;
  if (axes[2][most] < 0)
    for (int k = 0; k < 3; k++) axes[2][k] = 0 - axes[2][k];
  const double along[3] = {most != 0, most == 0, 0};
  for (int k = 0; k < 3; k++) axes[0][k] = along[k] - dot(along, axes[2]) * axes[2][k];
  normalise(axes[0]);
  cross(axes[2], axes[0], axes[1]);
  return true;
}

static int ascending(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

/* Smallest distance between different positions of `n` ascending ones; 0 if all are the same. */
static double least_step(const double *at, size_t n, double same) {
  double step = 0;
  for (size_t i = 1; i < n; i++)
    if (at[i] - at[i - 1] > same && (step == 0 || at[i] - at[i - 1] < step)) step = at[i] - at[i - 1];
  return step;
}

bool tc_dicom_contours_grid(const tc_dicom_contours *c, tc_volume_desc *d, GError **error) {
  double axes[3][3], lo[3] = {INFINITY, INFINITY, INFINITY}, hi[3] = {-INFINITY, -INFINITY, -INFINITY};
  if (!find_axes(c, axes)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "no contour encloses an area");
    return false;
  }
  double *planes = g_new(double, c->count);
  for (size_t i = 0; i < c->count; i++) {
    planes[i] = dot(corner_of(c, &c->list[i], 0), axes[2]);
    for (size_t j = 0; j < c->list[i].count; j++)
      for (int k = 0; k < 3; k++) {
        const double at = dot(corner_of(c, &c->list[i], j), axes[k]);
        lo[k] = fmin(lo[k], at);
        hi[k] = fmax(hi[k], at);
      }
  }
  qsort(planes, c->count, sizeof *planes, ascending);
  const double step = least_step(planes, c->count, 0.01), pixel = fmax(fmax(hi[0] - lo[0], hi[1] - lo[1]) / PIXELS_ACROSS, 0.01);
  lo[2] = planes[0];
  d->spacing[0] = d->spacing[1] = pixel;
  d->spacing[2] = step > 0 ? step : 1;
  for (int k = 0; k < 2; k++) {
    d->dims[k] = (int)ceil((hi[k] - lo[k]) / pixel) + 3;
    lo[k] -= pixel; /* a margin of one empty pixel */
  }
  const double layers = (planes[c->count - 1] - planes[0]) / d->spacing[2];
  g_free(planes);
  if (!(layers < 65536)) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "contours at distances that no grid has");
    return false;
  }
  d->dims[2] = (int)lround(layers) + 1;
  for (int r = 0; r < 3; r++) {
    d->origin[r] = lo[0] * axes[0][r] + lo[1] * axes[1][r] + lo[2] * axes[2][r];
    for (int k = 0; k < 3; k++) d->direction[3 * r + k] = axes[k][r];
  }
  return true;
}

/* ---- onto a grid ---- */

static int by_label_and_layer(const void *a, const void *b) {
  const tc_dicom_contour *x = a, *y = b;
  if (x->label != y->label) return x->label < y->label ? -1 : 1;
  return (x->layer > y->layer) - (x->layer < y->layer);
}

bool tc_dicom_contours_place(tc_dicom_contours *c, const tc_volume_desc *d, GError **error) {
  tc_volume_desc one = *d;
  for (int k = 0; k < 3; k++) one.dims[k] = 1;
  tc_volume *grid = tc_volume_new(&one, error); /* used for its conversion from mm to index coordinates */
  if (!grid) return false;
  bool good = true;
  for (size_t i = 0; i < c->count && good; i++) {
    tc_dicom_contour *contour = &c->list[i];
    double lo = INFINITY, hi = -INFINITY;
    for (size_t j = 0; j < contour->count; j++) {
      double *at = c->corners + 3 * (contour->first + j), index[3];
      tc_volume_lps_to_index(grid, at, index);
      memcpy(at, index, sizeof index);
      lo = fmin(lo, index[2]);
      hi = fmax(hi, index[2]);
    }
    contour->layer = 0.5 * (lo + hi);
    good = hi - lo <= 0.5;
    c->outside += contour->layer < -0.5 || contour->layer > d->dims[2] - 0.5;
  }
  tc_volume_unref(grid);
  if (good) qsort(c->list, c->count, sizeof *c->list, by_label_and_layer);
  if (!good) tc_set_error(error, TC_ERROR_FORMAT, NULL, "a contour is not parallel to the slices that it is drawn on");
  return good;
}

/* ---- filling ---- */

typedef struct crossing {
  int row;
  double x;
} crossing;

static int by_row(const void *a, const void *b) {
  const crossing *p = a, *q = b;
  if (p->row != q->row) return p->row < q->row ? -1 : 1;
  return (p->x > q->x) - (p->x < q->x);
}

/* Finds the places where a contour's edges cross the centres of rows. An edge includes its lower end only, so a
 * corner on a row counts once. */
static void add_crossings(const tc_dicom_contours *c, const tc_dicom_contour *contour, int rows, GArray *crossings) {
  for (size_t i = 0; i < contour->count; i++) {
    const double *a = corner_of(c, contour, i), *b = corner_of(c, contour, i + 1);
    if (a[1] > b[1]) {
      const double *swap = a;
      a = b;
      b = swap;
    }
    const double first = fmax(ceil(a[1]), 0), end = fmin(ceil(b[1]), rows);
    for (double row = first; row < end; row++) {
      const crossing at = {(int)row, a[0] + (row - a[1]) * (b[0] - a[0]) / (b[1] - a[1])};
      g_array_append_val(crossings, at);
    }
  }
}

static void fill_plane(const tc_dicom_contours *c, size_t first, size_t end, const tc_volume_desc *d, tc_overlaps *overlaps,
                       uint16_t *labels) {
  GArray *crossings = g_array_new(FALSE, FALSE, sizeof(crossing));
  for (size_t i = first; i < end; i++) add_crossings(c, &c->list[i], d->dims[1], crossings);
  g_array_sort(crossings, by_row);
  for (guint i = 0; i + 1 < crossings->len; i += 2) { /* closed contours cross each row an even number of times */
    const crossing *from = &g_array_index(crossings, crossing, i), *to = from + 1;
    uint16_t *row = labels + (size_t)from->row * (size_t)d->dims[0];
    const double last = fmin(ceil(to->x), d->dims[0]);
    for (double x = fmax(ceil(from->x), 0); x < last; x++)
      row[(size_t)x] = (uint16_t)tc_overlaps_label(overlaps, row[(size_t)x], c->list[first].label);
  }
  g_array_unref(crossings);
}

/* End of the plane that begins with contour `first`. */
static size_t end_of_plane(const tc_dicom_contours *c, size_t first, size_t end) {
  size_t i = first + 1;
  while (i < end && c->list[i].layer - c->list[first].layer <= SAME_PLANE) i++;
  return i;
}

/* First contour of the plane that `layer` takes, among a region's contours [first, end); `end` if there is none. */
static size_t plane_for(const tc_dicom_contours *c, size_t first, size_t end, int layer) {
  double step = 0;
  for (size_t i = first, next; i < end; i = next) {
    next = end_of_plane(c, i, end);
    const double gap = next < end ? c->list[next].layer - c->list[i].layer : 0;
    if (gap > 0 && (step == 0 || gap < step)) step = gap;
  }
  const double reach = fmax(0.5 * step, 0.5);
  for (size_t i = first, next; i < end; i = next) {
    next = end_of_plane(c, i, end);
    const double below = layer - c->list[i].layer, above = next < end ? c->list[next].layer - layer : INFINITY;
    if (below < 0) return i == first && -below < reach ? i : end;
    if (above <= 0) continue;
    if (below + above <= fmax(2 * step, 1) + SAME_PLANE) return below <= above ? i : next;
    if (below <= reach) return i;
    return above < reach ? next : end;
  }
  return end;
}

void tc_dicom_contours_fill(const tc_dicom_contours *c, const tc_volume_desc *d, int layer, tc_overlaps *overlaps,
                            uint16_t *labels) {
  memset(labels, 0, (size_t)d->dims[0] * (size_t)d->dims[1] * sizeof *labels);
  for (size_t first = 0, end; first < c->count; first = end) {
    for (end = first; end < c->count && c->list[end].label == c->list[first].label;) end++;
    const size_t plane = plane_for(c, first, end, layer);
    if (plane < end) fill_plane(c, plane, end_of_plane(c, plane, end), d, overlaps, labels);
  }
}
