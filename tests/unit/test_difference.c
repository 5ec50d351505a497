/* The measures a picture is judged by, against published and closed-form values. */
#include "tests/support/test.h"

#include "server/bench/difference.h"

static void close_to(const char *what, double got, double wanted, double tolerance) {
  if (!(fabs(got - wanted) <= tolerance)) fail_msg("%s: %.9g, expected %.9g within %g", what, got, wanted, tolerance);
}

/* The supplementary pairs of Sharma, Wu and Dalal, 2005: they sit on every discontinuity of the formula. */
TEST(ciede2000_published_pairs) {
  static const double pairs[][7] = {{50, 2.6772, -79.7751, 50, 0, -82.7485, 2.0425},
                                    {50, 3.1571, -77.2803, 50, 0, -82.7485, 2.8615},
                                    {50, 2.8361, -74.0200, 50, 0, -82.7485, 3.4412},
                                    {50, -1.3802, -84.2814, 50, 0, -82.7485, 1.0000},
                                    {50, -1.1848, -84.8006, 50, 0, -82.7485, 1.0000},
                                    {50, -0.9009, -85.5211, 50, 0, -82.7485, 1.0000},
                                    {50, 0, 0, 50, -1, 2, 2.3669},
                                    {50, -1, 2, 50, 0, 0, 2.3669},
                                    {50, 2.4900, -0.0010, 50, -2.4900, 0.0009, 7.1792},
                                    {50, 2.4900, -0.0010, 50, -2.4900, 0.0010, 7.1792},
                                    {50, 2.4900, -0.0010, 50, -2.4900, 0.0011, 7.2195},
                                    {50, 2.4900, -0.0010, 50, -2.4900, 0.0012, 7.2195},
                                    {50, -0.0010, 2.4900, 50, 0.0009, -2.4900, 4.8045},
                                    {50, -0.0010, 2.4900, 50, 0.0010, -2.4900, 4.8045},
                                    {50, -0.0010, 2.4900, 50, 0.0011, -2.4900, 4.7461},
                                    {50, 2.5, 0, 50, 0, -2.5, 4.3065},
                                    {50, 2.5, 0, 73, 25, -18, 27.1492},
                                    {50, 2.5, 0, 61, -5, 29, 22.8977},
                                    {50, 2.5, 0, 56, -27, -3, 31.9030},
                                    {50, 2.5, 0, 58, 24, 15, 19.4535},
                                    {50, 2.5, 0, 50, 3.1736, 0.5854, 1.0000},
                                    {50, 2.5, 0, 50, 3.2972, 0, 1.0000},
                                    {50, 2.5, 0, 50, 1.8634, 0.5757, 1.0000},
                                    {50, 2.5, 0, 50, 3.2592, 0.3350, 1.0000},
                                    {60.2574, -34.0099, 36.2677, 60.4626, -34.1751, 39.4387, 1.2644},
                                    {63.0109, -31.0961, -5.8663, 62.8187, -29.7946, -4.0864, 1.2630},
                                    {61.2901, 3.7196, -5.3901, 61.4292, 2.2480, -4.9620, 1.8731},
                                    {35.0831, -44.1164, 3.7933, 35.0232, -40.0716, 1.5901, 1.8645},
                                    {22.7233, 20.0904, -46.6940, 23.0331, 14.9730, -42.5619, 2.0373},
                                    {36.4612, 47.8580, 18.3852, 36.2715, 50.5065, 21.2231, 1.4146},
                                    {90.8027, -2.0831, 1.4410, 91.1528, -1.6435, 0.0447, 1.4441},
                                    {90.9257, -0.5406, -0.9208, 88.6381, -0.8985, -0.7239, 1.5381},
                                    {6.7747, -0.2908, -2.4247, 5.8714, -0.0985, -2.2286, 0.6377},
                                    {2.0776, 0.0795, -1.1350, 0.9033, -0.0636, -0.5514, 0.9082}};
  for (size_t i = 0; i < sizeof pairs / sizeof *pairs; i++) {
    close_to("ciede2000", tcs_ciede2000(pairs[i], pairs[i] + 3), pairs[i][6], 0.5e-4 + 1e-9);
    close_to("ciede2000 swapped", tcs_ciede2000(pairs[i] + 3, pairs[i]), pairs[i][6], 0.5e-4 + 1e-9);
    close_to("ciede2000 of a colour and itself", tcs_ciede2000(pairs[i], pairs[i]), 0, 0);
  }
}

/* Values as every colour calculator gives them for the sRGB primaries under D65. */
TEST(lab_of_known_colours) {
  static const double known[][6] = {{1, 1, 1, 100, 0, 0},
                                    {0, 0, 0, 0, 0, 0},
                                    {1, 0, 0, 53.2408, 80.0925, 67.2032},
                                    {0, 1, 0, 87.7347, -86.1827, 83.1793},
                                    {0, 0, 1, 32.2970, 79.1875, -107.8602}};
  for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
    double lab[3];
    tcs_lab(known[i], lab);
    for (int c = 0; c < 3; c++)
      close_to("lab", lab[c], known[i][3 + c], 0.02); /* the matrix's digits differ by source */
  }
}

enum { SIDE = 16, PIXELS = SIDE * SIDE };

TEST(ssim_of_known_pictures) {
  float a[PIXELS], b[PIXELS];
  for (int i = 0; i < PIXELS; i++) a[i] = (float)((i * 37 % 101) / 100.0);
  close_to("alike", tcs_ssim(a, a, SIDE, SIDE), 1, 1e-12);
  for (int i = 0; i < PIXELS; i++) a[i] = 0.25f, b[i] = 0.5f;
  const double c1 = 1e-4, c2 = 9e-4;
  close_to("two constants", tcs_ssim(a, b, SIDE, SIDE), (2 * 0.125 + c1) / (0.0625 + 0.25 + c1), 1e-9);
  /* Stripes and their negative, over a window of one row of stripes: means and variances are sums of Gaussian weights.
   */
  double w[11], even = 0, all = 0;
  for (int i = 0; i < 11; i++) {
    w[i] = exp(-0.5 * (i - 5) * (i - 5) / 2.25);
    all += w[i];
    if (i % 2 == 0) even += w[i];
  }
  for (int i = 0; i < PIXELS; i++) a[i] = i % SIDE % 2 == 0, b[i] = 1 - a[i];
  double m = even / all, v = m * (1 - m),
         expected = (2 * m * (1 - m) + c1) * (-2 * v + c2) / ((m * m + (1 - m) * (1 - m) + c1) * (2 * v + c2));
  close_to("stripes and their negative", tcs_ssim(a, b, SIDE, SIDE), expected, 1e-9);
  /* Smaller than the window: one window of the picture's size. */
  float p[4] = {0, 1, 0, 1}, q[4] = {1, 1, 0, 0};
  close_to("2x2", tcs_ssim(p, q, 2, 2), (2 * 0.25 + c1) * (0 + c2) / ((0.5 + c1) * (0.5 + c2)), 1e-9);
}

TEST(rms_percentile_and_maximum) {
  enum { N = 2000 };
  static float a[4 * N], b[4 * N];
  memset(a, 0, sizeof a);
  memset(b, 0, sizeof b);
  a[4 * 7 + 2] = 0.5f;  /* the worst */
  a[4 * 1000] = -0.25f; /* 99.9 % of 2000: the rank 1998, so the third worst */
  b[4 * 1500 + 3] = 0.125f;
  tcs_difference d;
  assert_true(tcs_compare_pixels(a, b, N, &d));
  close_to("max", d.max, 0.5, 0);
  close_to("p99.9", d.p999, 0.125, 0);
  double squares[3] = {0.25 / 4, 0.0625 / 4, 0.015625 / 4}, sum = squares[0] + squares[1] + squares[2];
  close_to("rms", d.rms, sqrt(sum / N), 1e-12);
  assert_true(d.rms_lo < d.rms && d.rms < d.rms_hi);
  /* A constant difference is known exactly. */
  for (int i = 0; i < 4 * N; i++) a[i] = 0.25f, b[i] = 0.5f;
  assert_true(tcs_compare_pixels(a, b, N, &d));
  close_to("constant: rms", d.rms, 0.25, 1e-12);
  close_to("constant: interval", d.rms_hi - d.rms_lo, 0, 1e-7);
  close_to("constant: p99.9", d.p999, 0.25, 0);
}

/* The interval holds the true value about 19 times of 20: 400 samples of a known distribution (a pixel is off by 1 with
 * probability 1/8, so the true mean square over four equal channels is 1/8). */
TEST(interval_holds_the_truth) {
  enum { TRIALS = 400, N = 500 };
  static float a[4 * N], b[4 * N];
  uint64_t s = 12345;
  int held = 0;
  for (int t = 0; t < TRIALS; t++) {
    for (int i = 0; i < N; i++) {
      s = s * 6364136223846793005u + 1442695040888963407u;
      for (int c = 0; c < 4; c++) a[4 * i + c] = s >> 61 == 0;
    }
    tcs_difference d;
    assert_true(tcs_compare_pixels(a, b, N, &d));
    held += d.rms_lo <= sqrt(0.125) && sqrt(0.125) <= d.rms_hi;
  }
  print_message("the interval held the truth %d times of %d\n", held, TRIALS);
  assert_in_range(held, 360, 398); /* 380 expected, standard deviation 4.4 */
}

TEST(pictures_are_judged_as_shown) {
  float clear[4 * PIXELS] = {0}, solid[4 * PIXELS];
  const tcs_look look = {{0.2, 0.4, 0.6}, false}, light = {{0.2, 0.4, 0.6}, true};
  for (int i = 0; i < PIXELS; i++)
    for (int c = 0; c < 4; c++) solid[4 * i + c] = c < 3 ? (float)look.background[c] : 1;
  tcs_difference d;
  assert_true(tcs_compare(clear, solid, SIDE, SIDE, &look, &d));
  close_to("what the background shows through is no difference", d.ciede_max, 0, 1e-4);
  close_to("and structurally alike", d.ssim, 1, 1e-6);
  close_to("but its opacity is", d.max, 1, 0);
  assert_true(tcs_compare(clear, solid, SIDE, SIDE, &light, &d));
  assert_true(d.ciede > 1); /* in linear light 0.2 is another colour */
}

TESTS(NULL, NULL)
