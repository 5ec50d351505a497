/* Comparison of pictures: floats, rgba interleaved. */
#ifndef TC_TEST_IMAGE_H
#define TC_TEST_IMAGE_H

#include <stdbool.h>
#include <stddef.h>

typedef struct test_difference {
  double rms, max, p999; /* of absolute differences, over all channels of all pixels; p999: 99.9th percentile */
  double mean;           /* signed, a - b: shows a bias */
  size_t worst;          /* index of the pixel with the maximum */
  bool finite;           /* a has no NaN or infinity */
} test_difference;

/* The greatest absolute difference of the four channels of one pixel. */
double test_pixel_off(const float *a, const float *b, size_t pixel);

test_difference test_compare(const float *a, const float *b, size_t pixels);

/* Prints one line: "what: rms .. max .. p99.9 .. mean .. (worst at x,y)". */
void test_print_difference(const char *what, const test_difference *difference, int width);

#endif
