#include "tests/support/image.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static int ascending(const void *a, const void *b) {
  float x = *(const float *)a, y = *(const float *)b;
  return (x > y) - (x < y);
}

double test_pixel_off(const float *a, const float *b, size_t pixel) {
  double off = 0;
  for (size_t c = 4 * pixel; c < 4 * pixel + 4; c++) off = fmax(off, fabs((double)a[c] - (double)b[c]));
  return off;
}

test_difference test_compare(const float *a, const float *b, size_t pixels) {
  test_difference d = {.finite = true};
  size_t n = 4 * pixels;
  float *sorted = malloc(n * sizeof *sorted);
  if (!sorted) abort();
  for (size_t i = 0; i < n; i++) {
    double e = (double)a[i] - (double)b[i];
    if (!isfinite(a[i])) {
      d.finite = false;
      e = INFINITY;
    }
    if (fabs(e) > d.max) {
      d.max = fabs(e);
      d.worst = i / 4;
    }
    d.rms += e * e;
    d.mean += e;
    sorted[i] = (float)fabs(e);
  }
  qsort(sorted, n, sizeof *sorted, ascending);
  d.p999 = (double)sorted[(size_t)(0.999 * (double)(n - 1))];
  d.rms = sqrt(d.rms / (double)n);
  d.mean /= (double)n;
  free(sorted);
  return d;
}

void test_print_difference(const char *what, const test_difference *d, int width) {
  printf("  %-58s rms %.2e max %.2e p99.9 %.2e mean %+.1e (%zu,%zu)%s\n", what, d->rms, d->max, d->p999, d->mean,
         d->worst % (size_t)width, d->worst / (size_t)width, d->finite ? "" : " NOT FINITE");
}
