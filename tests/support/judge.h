/* The invariants of every picture (NUMERICS section 5), asked of one case on every renderer:
 *   no NaN, opacity within 0..1, colour within opacity times the brightest there is; leaping changes no bit, threads
 *   change no bit; early termination changes at most its threshold; both orders agree; renderers agree but for ties,
 *   which the scalar renderer shows too when the view moves by a hair; the reference keeps the same bounds, and the
 *   transparency along its rays never grows. */
#ifndef TC_TEST_JUDGE_H
#define TC_TEST_JUDGE_H

#include "tests/support/cases.h"
#include "tests/support/renderers.h"

enum { TEST_ON_REFERENCE = 1 << RENDERERS, TEST_ON_ALL = (2 << RENDERERS) - 1 }; /* beside 1 << SCALAR ... 1 << GL */

typedef struct test_tally {
  /* drawn; left out as unsupported by the back end; by the reference */
  size_t cases[RENDERERS], refused[RENDERERS], referenced;
  size_t pixels, shown;                                    /* a suite of empty pictures would judge nothing */
  /* pixels beside the scalar ones; those further off than 1/255 */
  size_t compared[RENDERERS], ties[RENDERERS], faults[RENDERERS];
  double most_ties[RENDERERS];                             /* the largest share in one picture of at least 12 pixels */
  uint64_t worst[RENDERERS];                               /* its seed */
  /* the same of pictures of the voxels' last bits (judge.c: shows_last_bits), which are in none of the above */
  size_t last_compared[RENDERERS], last_ties[RENDERERS];
} test_tally;
extern test_tally test_judged;
extern char test_judged_why[600]; /* what was broken */

int test_judge_open(void **state); /* test_renderers_open, and one with a single thread */
int test_judge_close(void **state);

/* False: test_judged_why says what is broken. *c is fitted (test_case_fit). on: which renderers, by their bits. A
 * renderer that refuses the case as unsupported is left out. */
bool test_judge(const test_case *c, unsigned on);

/* A picture's bounds alone. which: a renderer's number, for the words. */
bool test_judge_picture(int which, const tc_scene *scene, const tc_frame *frame);

/* One line for each renderer: how much it was asked, and how many pixels are ties. */
void test_judge_print(void);

#endif
