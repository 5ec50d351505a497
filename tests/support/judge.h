/* The invariants of every picture (NUMERICS section 5), checked for one case on every renderer:
 *   no NaN, opacity within 0..1, colour at most opacity times the brightest colour; empty-space skipping and the number
 *   of threads change no bit; early termination changes at most its threshold; both compositing orders agree; renderers
 *   agree except for ties, which the scalar renderer shows too when the view moves slightly; the reference keeps the
 *   same bounds, and the transparency along its rays never grows. */
#ifndef TC_TEST_JUDGE_H
#define TC_TEST_JUDGE_H

#include "tests/support/cases.h"
#include "tests/support/renderers.h"

enum { TEST_ON_REFERENCE = 1 << RENDERERS, TEST_ON_ALL = (2 << RENDERERS) - 1 }; /* besides 1 << SCALAR ... 1 << GL */

typedef struct test_tally {
  /* drawn; refused as unsupported by the back end; checked by the reference */
  size_t cases[RENDERERS], refused[RENDERERS], referenced;
  size_t pixels, shown; /* shown: not transparent; empty pictures check nothing */
  /* pixels compared with scalar ones; of these, those that differ by over 1/255; of these, those that are no ties */
  size_t compared[RENDERERS], ties[RENDERERS], faults[RENDERERS];
  double most_ties[RENDERERS]; /* largest share in a picture of 12 or more pixels */
  uint64_t worst[RENDERERS];   /* seed of that picture */
  /* the same counts for pictures of the voxels' last bits (judge.c: shows_last_bits), which are not in the counts above
   */
  size_t last_compared[RENDERERS], last_ties[RENDERERS];
} test_tally;
extern test_tally test_judged;
extern char test_judged_why[600]; /* the violated invariant */

int test_judge_open(void **state); /* test_renderers_open(), and a renderer with a single thread */
int test_judge_close(void **state);

/* Checks all invariants. False: see test_judged_why. *c must be fitted (test_case_fit). on: bits of the renderers.
 * Skips a renderer that refuses the case as unsupported. */
bool test_judge(const test_case *c, unsigned on);

/* Checks only the bounds of one picture. which: the renderer, for the message. */
bool test_judge_picture(int which, const tc_scene *scene, const tc_frame *frame);

/* Prints a line for each renderer: number of cases and of ties. */
void test_judge_print(void);

#endif
