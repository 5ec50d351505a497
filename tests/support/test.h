/* What every test of C includes: cmocka with the headers that it wants before it, and the C library's usual ones. */
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

#include <cmocka.h> /* after those: it declares nothing itself of what it uses */

#define TEST(function) cmocka_unit_test(function)

/* Leaves a test out where the machine lacks what it wants. */
#define needs(what) do { if (!(what)) skip(); } while (0)
/* For files with a GError `error` of their own. */
#define assert_made(what) do { if (!(what)) fail_msg("%s", error ? error->message : #what); } while (0)

#endif
