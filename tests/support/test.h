/* Included by every C test: cmocka, with the headers it needs, and the usual ones of the C library. */
#ifndef TC_TEST_TEST_H
#define TC_TEST_TEST_H

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h> /* after those above, which it needs but does not include */

/* Write TEST(what_it_promises) { ... } in a file that ends with TESTS(set_up, tear_down), which run once for all tests
 * (NULL: none). The tests run in file order. TEST_WITH: a set-up and tear-down for one test (NULL: none); `state` is
 * cmocka's. */
#define TEST(name) TEST_OF(name, NULL, NULL, no_state)
#define TEST_WITH(name, set_up, tear_down) TEST_OF(name, set_up, tear_down, state)
#define TEST_OF(name, set_up, tear_down, parameter)                                              \
  static void name(void **parameter);                                                            \
  __attribute__((constructor)) static void add_##name(void) {                                    \
    add_test((struct CMUnitTest){#name, name, set_up, tear_down, NULL});                         \
  }                                                                                              \
  static void name(void **parameter)
#define TESTS(set_up, tear_down) \
  int main(void) { return run_all_tests(set_up, tear_down); }

static struct CMUnitTest all_tests[64];
static size_t n_tests;

static inline void add_test(struct CMUnitTest test) {
  if (n_tests == sizeof all_tests / sizeof *all_tests) abort();
  all_tests[n_tests++] = test;
}

static inline int run_all_tests(CMFixtureFunction set_up, CMFixtureFunction tear_down) {
  return _cmocka_run_group_tests(__FILE__, all_tests, n_tests, set_up, tear_down);
}

/* Whether a checker of memory watches, which makes code several times slower. It wants every path, not every case: figures are
 * judged without it. */
#ifdef __SANITIZE_ADDRESS__
enum { SANITIZED = 1 };
#else
enum { SANITIZED = 0 };
#endif
/* How far to step in loops over cases that differ in values and not in code: `most` under such a checker, else 1. */
#define STRIDE(most) (SANITIZED ? (most) : 1)

/* Skips a test if the machine lacks what it needs. */
#define needs(what) do { if (!(what)) skip(); } while (0)
/* For files with their own GError `error`. */
#define assert_made(what) do { if (!(what)) fail_msg("%s", error ? error->message : #what); } while (0)

#endif
