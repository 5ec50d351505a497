/* Random scenes over tiny volumes: drawn from a seed, judged, and made smaller while they still fail.
 *
 * A case is plain data: copying it copies the scene. What a version does not build is replaced by its default before a case
 * is judged (test_case_fit), so that new abilities are drawn as soon as the plan takes them. */
#ifndef TC_TEST_CASES_H
#define TC_TEST_CASES_H

#include "renderer/scene.h"
#include "renderer/volume/volume.h"

#define TEST_MAX_KNOTS 12

typedef enum test_pattern {
  TEST_NOISE,    /* uniform, independent per voxel */
  TEST_CONSTANT,
  TEST_RAMP,     /* along x, y and z at three rates */
  TEST_LEVELS,   /* three values: neighbours are equal to the last bit */
  TEST_SPIKES,   /* the low end, and now and then the high one */
  TEST_ODD,      /* noise with NaN, infinities, the largest and the smallest floats; noise for integers */
  TEST_PATTERN_COUNT
} test_pattern;

typedef struct test_case {
  uint64_t seed;
  int dims[3];
  tc_voxel_type type;
  double spacing[3], origin[3], slope, intercept;
  bool sheared;
  test_pattern pattern;
  double lo, hi; /* voxel values (not rescaled) that the pattern spans */
  tc_projection projection;
  double side[3], inside; /* inside: how far from outside to the volume's centre the eye has gone, 0..1 */
  double zoom; /* of the field of view that shows all of the volume, 0..1 */
  tc_knot knots[TEST_MAX_KNOTS]; /* value: 0..1 of lo..hi, not yet rescaled */
  size_t n_knots;
  tc_scene scene; /* camera, knots and clip box are set by test_case_volume */
} test_case;

test_case test_case_random(uint64_t seed);

/* The volume (the caller's), after *scene is completed: it points into *c for its knots, and is not to be cleared. */
tc_volume *test_case_volume(test_case *c);

/* Takes away what the plan calls unsupported; false where nothing is left to take, or the plan refuses it otherwise:
 * *refusal is then "code pointer message" (g_free it). */
bool test_case_fit(test_case *c, char **refusal);

/* Makes a copy smaller while `fails` says that it still fails, and returns the smallest found. */
test_case test_case_shrink(const test_case *c, bool (*fails)(test_case *c));

/* The volume's recipe and the scene as JSON. */
void test_case_print(test_case *c);

#endif
