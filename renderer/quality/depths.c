#include "renderer/quality/depths.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/raycast/subpixel.h"
#include "renderer/reference/reference.h"

void tc_depths_exact(const tc_reference *reference, const tc_scene *scene, int x, int y, tc_depths *pixel) {
  tc_subpixel rays[TC_MAX_RAYS_PER_PIXEL];
  const int count = scene->sampling.rays_per_pixel;
  pixel->nearest = INFINITY;
  pixel->surface = 0, pixel->label = 0;
  tc_subpixel_rays(count, rays);
  for (int r = 0; r < count; r++) {
    tc_reference_hit hit;
    if (!tc_reference_surface(reference, x + 0.5 + rays[r].x, y + 0.5 + rays[r].y, &hit)) continue;
    if (hit.distance_mm >= pixel->nearest) continue;
    pixel->nearest = hit.distance_mm;
    pixel->surface = hit.surface, pixel->label = hit.label;
  }
}

void tc_depths_exact_layers(const tc_reference *reference, int x, int y, tc_depths layers[TC_FRAME_LAYERS]) {
  double mm[TC_FRAME_LAYERS];
  const int n = tc_reference_layers(reference, x + 0.5, y + 0.5, mm, TC_FRAME_LAYERS);
  for (int i = 0; i < TC_FRAME_LAYERS; i++) layers[i].nearest = i < n ? mm[i] : INFINITY, layers[i].surface = 0, layers[i].label = 0;
}

/* Error of a pixel in mm; below 0: only one of picture and reference has a surface. */
static double apart(const tc_depths *p) {
  if (!isfinite(p->drawn) || !isfinite(p->nearest)) return -1;
  return fabs(p->drawn - p->nearest);
}

static int by_apart(const void *a, const void *b) {
  const double x = apart(a), y = apart(b);
  return (x > y) - (x < y);
}

/* By surface, label and error; pixels without an exact surface first. */
static int by_surface(const void *a, const void *b) {
  const tc_depths *p = a, *q = b;
  if (isfinite(p->nearest) != isfinite(q->nearest)) return isfinite(p->nearest) ? 1 : -1;
  if (p->surface != q->surface) return p->surface < q->surface ? -1 : 1;
  return p->label != q->label ? (p->label < q->label ? -1 : 1) : by_apart(a, b);
}

static int by_pixels(const void *a, const void *b) {
  const tc_depth_error *p = a, *q = b;
  const int n = p->both + p->one, m = q->both + q->one;
  return n != m ? (n > m ? -1 : 1) : (p->surface > q->surface) - (p->surface < q->surface);
}

/* Percentile of the errors of n pixels in ascending order (nearest rank). */
static double percentile(const tc_depths *ascending, int n, int percent) {
  return apart(&ascending[((int64_t)n * percent + 99) / 100 - 1]);
}

/* Error over pixels sorted by by_apart(); all: number of pixels of the whole picture. */
static tc_depth_error error_of(const tc_depths *pixels, int n, int all) {
  tc_depth_error e = {0};
  int first = 0;
  double squares = 0;
  for (; first < n && apart(&pixels[first]) < 0; first++)
    e.one += isfinite(pixels[first].drawn) || isfinite(pixels[first].nearest);
  for (int i = first; i < n; i++) squares += apart(&pixels[i]) * apart(&pixels[i]);
  e.outline = all ? (double)e.one / all : 0;
  e.both = n - first;
  if (!e.both) return e;
  e.rms = sqrt(squares / e.both);
  e.p50 = percentile(pixels + first, e.both, 50);
  e.p99 = percentile(pixels + first, e.both, 99);
  e.max = percentile(pixels + first, e.both, 100);
  return e;
}

/* Inserts a surface into `each`, which keeps the `most` surfaces with the most pixels; *n: number so far. */
static void keep(tc_depth_error *each, int *n, int most, const tc_depth_error *one) {
  if (*n < most)
    each[(*n)++] = *one;
  else if (most > 0 && by_pixels(one, &each[most - 1]) < 0)
    each[most - 1] = *one;
  else
    return;
  qsort(each, (size_t)*n, sizeof *each, by_pixels);
}

int tc_depths_compare(tc_depths *pixels, int n, tc_depth_error *all, tc_depth_error *each, int most) {
  int found = 0, from = 0;
  qsort(pixels, (size_t)n, sizeof *pixels, by_apart);
  *all = error_of(pixels, n, n);
  qsort(pixels, (size_t)n, sizeof *pixels, by_surface);
  while (from < n && !isfinite(pixels[from].nearest)) from++;
  for (int to; from < n; from = to) {
    for (to = from; to < n && pixels[to].surface == pixels[from].surface && pixels[to].label == pixels[from].label;) to++;
    tc_depth_error one = error_of(pixels + from, to - from, n);
    one.surface = pixels[from].surface, one.label = pixels[from].label;
    keep(each, &found, most, &one);
  }
  return found;
}
