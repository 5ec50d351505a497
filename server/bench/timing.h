/* Helpers for measured times. */
#ifndef TC_SERVER_TIMING_H
#define TC_SERVER_TIMING_H

#include <glib.h>
#include <stdlib.h>

static inline double tcs_now_ms(void) { return (double)g_get_monotonic_time() / 1e3; }

static inline int tcs_compare_doubles(const void *a, const void *b) {
  const double x = *(const double *)a, y = *(const double *)b;
  return (x > y) - (x < y);
}

static inline void tcs_sort(double *ms, size_t count) { qsort(ms, count, sizeof *ms, tcs_compare_doubles); }

/* Sorts the times. */
static inline double tcs_median(double *ms, size_t count) {
  tcs_sort(ms, count);
  return count % 2 ? ms[count / 2] : 0.5 * (ms[count / 2 - 1] + ms[count / 2]);
}

#endif
