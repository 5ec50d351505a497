/* Jitter as such; what it does to pictures is in tests/accuracy/test_subpixel.c. */
#include "tests/support/test.h"

#include "renderer/raycast/jitter.h"

TEST(jitter_is_even) {
  double sum = 0, worst = 0;
  for (uint32_t y = 0; y < 256; y++)
    for (uint32_t x = 0; x < 256; x++) {
      double local = 0;
      for (uint32_t i = 0; i < 9; i++) local += tc_jitter_phase(x + 7000 + i % 3, y + 5000 + i / 3) / 9;
      worst = fmax(worst, fabs(local - 0.5));
      double phase = tc_jitter_phase(x, y);
      assert_true(phase > 0 && phase <= 1);
      sum += phase / 65536;
    }
  printf("  mean phase %.5f; means of 3x3 pixels within %.3f of a half\n", sum, worst);
  assert_true(fabs(sum - 0.5) < 1e-3 && worst < 0.1); /* white noise: 0.1 is one deviation of such a mean */
}

TESTS(NULL, NULL)
