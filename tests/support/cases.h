/* Random scenes over tiny volumes: generated from a seed, checked (judge.h), and shrunk while they still fail.
 *
 * The members that select a kernel or shader program (mode, voxel type, filter ...) stay the same for TEST_STYLE_SEEDS
 * successive seeds, since compiling a program takes longer than drawing many small pictures with it.
 *
 * A case is plain data: copying it copies the scene. Features that are not built are replaced by their defaults before
 * a case is checked (test_case_fit), so that new features are tested as soon as the plan accepts them. */
#ifndef TC_TEST_CASES_H
#define TC_TEST_CASES_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

#define TEST_MAX_KNOTS 12
#define TEST_STYLE_SEEDS 10

typedef enum test_pattern {
  TEST_NOISE, /* uniform, independent per voxel */
  TEST_CONSTANT,
  TEST_RAMP,   /* along x, y and z with three slopes */
  TEST_LEVELS, /* three values, so that neighbours are often equal */
  TEST_SPIKES, /* mostly the low end, sometimes the high end */
  TEST_ODD,    /* noise with NaN, infinities, the largest and the smallest floats; plain noise for integers */
  TEST_PATTERN_COUNT
} test_pattern;

/* A label grid that contains the volume's centre. */
typedef struct test_label_recipe {
  bool on, turned, some_visible; /* some_visible: only the labels listed */
  int dims[3];
  tc_voxel_type type;
  /* extents, relative to the volume's; offset between the centres, relative to the grid's extents */
  double size[3], shift[3];
  int first, count; /* voxels hold random labels first .. first + count - 1 */
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
  double lo, hi; /* range of the stored voxel values */
  tc_projection projection;
  double side[3], inside; /* inside: how far the eye has moved from outside to the volume's centre, 0..1 */
  bool at_eye;            /* the eye is inside the volume's box instead, at `eye` (0..1) */
  double eye[3];
  bool at_place; /* the target is at `place` (0..1) instead of the box's centre */
  double place[3];
  bool fine;                     /* keeps the step, however many samples a ray has */
  double far_mm;                 /* if not 0: distance of the eye, with the field of view narrowed to match */
  double fov_deg;                /* if not 0: field of view in perspective */
  double zoom;                   /* part of the field of view that shows the whole volume, 0..1 */
  tc_knot knots[TEST_MAX_KNOTS]; /* value: 0..1 of lo..hi, not rescaled */
  size_t n_knots;                /* above TEST_MAX_KNOTS: spread evenly over 0..1, repeating colours and amounts */
  test_label_recipe labels;
  int table_size; /* of the render request */
  bool subtables; /* table of the plan's choice, with subtables */
  tc_scene scene; /* camera, knots, clip box and label colours are set by test_case_volume */
} test_case;

test_case test_case_random(uint64_t seed);

/* Makes the volume (caller's reference) and completes c->scene, which points into *c and to knots that the next call
 * overwrites. Do not clear the scene. */
tc_volume *test_case_volume(test_case *c);

/* Makes the label volume (caller's reference); NULL for a case without labels. */
tc_volume *test_case_labels(const test_case *c, const tc_volume *volume);

/* Resets members that the plan calls unsupported. False: nothing left to reset, or another refusal; *refusal is then
 * "code pointer message" (g_free it). */
bool test_case_fit(test_case *c, char **refusal);

/* Simplifies a copy as long as `fails` returns true, and returns the smallest failing case. */
test_case test_case_shrink(const test_case *c, bool (*fails)(test_case *c));

/* Prints the volume's recipe, and the scene as JSON. */
void test_case_print(test_case *c);

#endif
