/* Random scenes on every back end and instruction set against the invariants of every picture (tests/support/judge.h).
 *
 * TC_RANDOM_SCENES: how many (500; fewer under a sanitizer); TC_RANDOM_SEED: only this one, or the first
 * of TC_RANDOM_SCENES. A scene that fails is made smaller and printed. */
#include "tests/support/test.h"

#include "tests/support/judge.h"

enum { USUAL_SCENES = SANITIZED ? 150 : 500 };

static bool still_fails(test_case *c) { return !test_judge(c, TEST_ON_ALL); }

/* Compiling its GL programs takes three quarters of the time of a case: later cases mostly do without. */
enum { WITH_GL = 75, ONE_IN = 16 };
static unsigned judges(uint64_t index) {
  return index < WITH_GL || index % ONE_IN == 0 ? TEST_ON_ALL : TEST_ON_ALL & ~(1u << GL);
}

static bool judge(uint64_t seed, unsigned on, bool show) {
  test_case c = test_case_random(seed);
  char *refusal = NULL;
  if (!test_case_fit(&c, &refusal)) fail_msg("seed %llu is refused: %s", (unsigned long long)seed, refusal);
  if (show) test_case_print(&c);
  if (test_judge(&c, on)) return true;
  printf("  seed %llu (TC_RANDOM_SEED repeats it) fails: %s\n", (unsigned long long)seed, test_judged_why);
  test_case small = test_case_shrink(&c, still_fails);
  test_judge(&small, TEST_ON_ALL);
  printf("  made smaller: %s\n", test_judged_why);
  test_case_print(&small);
  fflush(stdout);
  return false;
}

TEST(random_scenes) {
  const char *count = getenv("TC_RANDOM_SCENES"), *only = getenv("TC_RANDOM_SEED");
  uint64_t n = count ? strtoull(count, NULL, 10) : only ? 1 : USUAL_SCENES, first = only ? strtoull(only, NULL, 10) : 1;
  int failed = 0;
  for (uint64_t seed = first; seed < first + n && failed < 10; seed++) {
    failed += !judge(seed, judges(seed - first), n == 1);
    if ((seed - first + 1) % 1000 == 0 &&
        printf("  %llu of %llu\n", (unsigned long long)(seed - first + 1), (unsigned long long)n))
      fflush(stdout);
  }
  test_judge_print();
  assert_int_equal(failed, 0);
  for (int i = AVX2; i < RENDERERS && n >= USUAL_SCENES; i++)
    assert_true((double)test_judged.ties[i] <= 0.01 * (double)test_judged.compared[i]);
  assert_true(only || test_judged.shown > test_judged.pixels / 5);
}

TESTS(test_judge_open, test_judge_close)
