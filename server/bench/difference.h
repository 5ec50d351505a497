/* Metrics of the difference between two pictures, by which `tomocast report` judges a frame.
 *
 * Pure functions; any thread. Pictures are float [height][width][4], premultiplied colour in the compositing space and
 * opacity, as in tc_frame.linear and from the reference. */
#ifndef TC_SERVER_DIFFERENCE_H
#define TC_SERVER_DIFFERENCE_H

#include <stdbool.h>
#include <stddef.h>

/* How a picture is displayed: over which background (sRGB 0..1), and whether its colours are linear light. */
typedef struct tcs_look {
  double background[3];
  bool linear_light;
} tcs_look;

typedef struct tcs_difference {
  size_t pixels;
  double rms;              /* over the four channels of all pixels */
  double rms_lo, rms_hi;   /* 95 % interval of rms, with the pixels as a sample of the picture plane */
  double p999, max;        /* of each pixel's largest channel difference: 99.9th percentile and maximum */
  double ciede, ciede_max; /* CIEDE2000 of the displayed pixels: mean and maximum */
  double ssim;             /* of the displayed luma, 1 = equal */
} tcs_difference;

/* Compares a with b. False: out of memory. */
bool tcs_compare(const float *a, const float *b, int width, int height, const tcs_look *look, tcs_difference *out);

/* Only rms, its interval, p999 and max, of `pixels` pixels in any order. False: out of memory. */
bool tcs_compare_pixels(const float *a, const float *b, size_t pixels, tcs_difference *out);

/* CIE L*a*b* (D65, 2 degrees) of an sRGB colour 0..1 (IEC 61966-2-1). */
void tcs_lab(const double srgb[3], double lab[3]);

/* CIEDE2000 with kL = kC = kH = 1 (CIE 142; Sharma, Wu, Dalal, Color Res. Appl. 30(1), 2005). */
double tcs_ciede2000(const double lab1[3], const double lab2[3]);

/* Mean structural similarity of two grey pictures, 0..1 (Wang, Bovik, Sheikh, Simoncelli, IEEE TIP 13(4), 2004):
 * Gaussian window of 11 x 11 with sigma 1.5, or the picture's size if smaller, K1 = 0.01, K2 = 0.03, only windows
 * inside the picture. NAN: out of memory. */
double tcs_ssim(const float *a, const float *b, int width, int height);

#endif
