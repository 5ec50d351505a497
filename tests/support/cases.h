/* Random scenes over tiny volumes: drawn from a seed, judged (judge.h), and made smaller while they still fail.
 *
 * What chooses a kernel or a shader program (mode, voxel type, filter ...) is the same for TEST_STYLE_SEEDS seeds in a
 * row: compiling one takes longer than drawing many small pictures with it.
 *
 * A case is plain data: copying it copies the scene. What a version does not build is replaced by its default before a
 * case is judged (test_case_fit), so that new abilities are drawn as soon as the plan takes them. */
#ifndef TC_TEST_CASES_H
#define TC_TEST_CASES_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

#define TEST_MAX_KNOTS 12
#define TEST_STYLE_SEEDS 10

typedef enum test_pattern {
  TEST_NOISE,    /* uniform, independent per voxel */
  TEST_CONSTANT,
  TEST_RAMP,     /* along x, y and z at three rates */
  TEST_LEVELS,   /* three values: neighbours are equal to the last bit */
  TEST_SPIKES,   /* the low end, and now and then the high one */
  TEST_ODD,      /* noise with NaN, infinities, the largest and the smallest floats; noise for integers */
  TEST_PATTERN_COUNT
} test_pattern;

/* A grid of labels about the volume's centre, which it always holds. */
typedef struct test_label_recipe {
  bool on, turned, some_visible; /* some_visible: only those listed */
  int dims[3];
  tc_voxel_type type;
  /* extents, of the volume's; where the volume's centre is, from the grid's, of the grid's extents */
  double size[3], shift[3];
  int first, count;         /* voxels hold first .. first + count - 1, drawn one by one */
  double slope, intercept;
  tc_label_color colors[4];
  uint32_t visible[4];
} test_label_recipe;

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
  bool at_eye;   /* the eye is at a place of the volume's box instead, each of 0..1 across it */
  double eye[3];
  bool at_place; /* the view's centre is at such a place too, not at the box's */
  double place[3];
  bool fine;     /* the step is as asked, however many samples a ray has */
  double far_mm; /* not 0: the eye goes that far, the view staying as wide */
  double fov_deg; /* not 0: of a perspective view */
  double zoom; /* of the field of view that shows all of the volume, 0..1 */
  tc_knot knots[TEST_MAX_KNOTS]; /* value: 0..1 of lo..hi, not yet rescaled */
  size_t n_knots; /* more than TEST_MAX_KNOTS: evenly over 0..1, colours and amounts repeating */
  test_label_recipe labels;
  int table_size; /* of the request */
  bool subtables;    /* the table is to be the plan's choice, with its subtables */
  tc_scene scene; /* camera, knots, clip box and colours of labels are set by test_case_volume */
} test_case;

test_case test_case_random(uint64_t seed);

/* The volume (the caller's), after c->scene is completed: it points into *c and to knots that the next call writes
 * anew, and is not to be cleared. */
tc_volume *test_case_volume(test_case *c);

/* The label volume (the caller's) of a case without labels is NULL. */
tc_volume *test_case_labels(const test_case *c, const tc_volume *volume);

/* Takes away what the plan calls unsupported; false where nothing is left to take, or the plan refuses it otherwise:
 * *refusal is then "code pointer message" (g_free it). */
bool test_case_fit(test_case *c, char **refusal);

/* Makes a copy smaller while `fails` says that it still fails, and returns the smallest found. */
test_case test_case_shrink(const test_case *c, bool (*fails)(test_case *c));

/* The volume's recipe and the scene as JSON. */
void test_case_print(test_case *c);

#endif
