/* The size of GPU dispatches follows what earlier ones took, on devices of any speed. */
#include "tests/support/test.h"

#include "renderer/raycast/gl/pace.h"

typedef struct device {
  const char *name;
  bool hardware;
  double sample_ns, ray_ns; /* ray_ns: of the pixels that it draws at once */
} device;

/* Many samples may be left out; never more than are counted. */
static double takes_ms(const device *d, int pixels, double samples, double dense) {
  return fmax(pixels * d->sample_ns, d->ray_ns) * samples * dense * 1e-6 + 0.05;
}

/* A picture of 2^20 pixels, clear at first and dense then. Returns the longest dispatch after the first dense one. */
static double draw(const device *d, tc_gl_pace *pace, double samples, double *first, int *dispatches) {
  double longest = 0;
  bool dense_before = false;
  *first = 0;
  *dispatches = 0;
  for (int drawn = 0; drawn < 1 << 20; ++*dispatches) {
    const int pixels = tc_gl_pace_pixels(pace, samples);
    const bool dense = drawn >= 1 << 18;
    const double ms = takes_ms(d, pixels, samples, dense ? 1 : 0.001);
    if (dense_before) longest = fmax(longest, ms);
    else if (dense) *first = ms;
    dense_before = dense;
    tc_gl_pace_learn(pace, pixels, samples, ms);
    drawn += pixels;
  }
  return longest;
}

TEST(dispatches_are_short) {
  static const device devices[] = {{"large GPU", true, 0.01, 300},     {"known GPU", true, 0.1, 1000},
                                   {"slow GPU", true, 1.5, 1500},      {"very slow GPU", true, 20, 1500},
                                   {"software", false, 10, 0},         {"software, busy", false, 300, 0}};
  for (size_t i = 0; i < sizeof devices / sizeof *devices; i++) {
    const device *d = &devices[i];
    for (double samples = 1; samples < 10000; samples *= 5) {
      tc_gl_pace pace;
      double first, longest;
      int dispatches, again;
      tc_gl_pace_init(&pace, d->hardware, d->hardware ? 1 << 20 : 1 << 16);
      longest = draw(d, &pace, samples, &first, &dispatches);
      double then = draw(d, &pace, samples, &first, &again);
      /* what no smaller tile makes shorter */
      double least = takes_ms(d, d->hardware ? 4096 : 64, samples, 1);
      printf("  %-14s %5.0f samples: at most %6.1f ms, then %6.1f, first dense %6.1f; %d and %d dispatches\n", d->name,
             samples, longest, then, first, dispatches, again);
      assert_true(longest <= fmax(20, least) && then <= fmax(20, least));
      if (samples == 1 && d->hardware) assert_int_equal(tc_gl_pace_pixels(&pace, 1), 1 << 20);
    }
  }
}

/* One dispatch that something else held up makes the next ones small, and is forgotten. */
TEST(a_hiccup_passes) {
  tc_gl_pace pace;
  tc_gl_pace_init(&pace, true, 1 << 20);
  for (int i = 0; i < 100; i++) tc_gl_pace_learn(&pace, 1 << 20, 100, 10);
  const int before = tc_gl_pace_pixels(&pace, 100);
  tc_gl_pace_learn(&pace, 1 << 16, 100, 500);
  assert_true(tc_gl_pace_pixels(&pace, 100) < before / 8);
  for (int i = 0; i < 100; i++) tc_gl_pace_learn(&pace, 1 << 16, 100, 1);
  assert_int_equal(tc_gl_pace_pixels(&pace, 100), before);
  const double rays = tc_gl_pace_least_ms(&pace, 1000);
  tc_gl_pace_learn(&pace, 4096, 1, 500); /* of one sample: not what a ray takes */
  assert_true(tc_gl_pace_least_ms(&pace, 1000) <= 2 * rays);
}

/* Rays that are slow themselves are found out. */
TEST(slow_rays_are_known) {
  tc_gl_pace pace;
  tc_gl_pace_init(&pace, true, 1 << 20);
  for (int i = 0; i < 6; i++) tc_gl_pace_learn(&pace, 4096, 1000, 30);
  assert_true(tc_gl_pace_least_ms(&pace, 1000) > 25);
  assert_true(tc_gl_pace_pixels(&pace, 10) >= 4096);
}

TESTS(NULL, NULL)
