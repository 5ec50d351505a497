/* Comparing pictures: floats, rgba interleaved. */
#ifndef TC_TEST_IMAGE_H
#define TC_TEST_IMAGE_H

#include <stdbool.h>
#include <stddef.h>

typedef struct test_difference {
  double rms, max, p999; /* over all channels of all pixels: absolute differences; p999: 99.9th percentile */
  double mean;           /* signed, a - b: a bias shows here */
  size_t worst;          /* pixel of the maximum */
  bool finite;           /* nothing in a is NaN or infinite */
} test_difference;

test_difference test_compare(const float *a, const float *b, size_t pixels);

/* One line: "what: rms .. max .. p99.9 .. mean .. (worst at x,y)". */
void test_print_difference(const char *what, const test_difference *difference, int width);

#endif
