/* Volume storage: checks, range, mending, orientation, interpolation, histogram, demos. */
#include "tests/support/test.h"

#include "renderer/volume/demo.h"
#include "renderer/volume/histogram.h"
#include "renderer/volume/volume.h"
#include "tests/support/scoped.h"

static tc_volume_desc desc(int x, int y, int z, tc_voxel_type type) {
  return (tc_volume_desc){
      .dims = {x, y, z}, .type = type, .spacing = {1, 1, 1}, .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1};
}

static void refused(tc_volume_desc d, tc_error_code code) {
  g_autoptr(GError) error = NULL;
  assert_null(tc_volume_new(&d, &error));
  assert_int_equal(error->code, code);
}

TEST(nonsense_is_refused) {
  refused(desc(0, 1, 1, TC_U8), TC_ERROR_INVALID);
  refused(desc(65536, 65536, 1, TC_U8), TC_ERROR_LIMIT);
  refused(desc(INT32_MAX, INT32_MAX, INT32_MAX, TC_F32), TC_ERROR_LIMIT);
  tc_volume_desc d = desc(2, 2, 2, TC_U8);
  d.spacing[1] = 0;
  refused(d, TC_ERROR_INVALID);
  d = desc(2, 2, 2, TC_U8);
  d.spacing[1] = NAN;
  refused(d, TC_ERROR_INVALID);
  d = desc(2, 2, 2, TC_U8);
  d.origin[1] = 1e12; /* the file's fault, not the camera's that would have to look at it */
  refused(d, TC_ERROR_FORMAT);
  const double scales[][2] = {{0, 0}, {-1e306, 0}, {1e-306, 0}, {NAN, 0}, {1, INFINITY}, {1, 1e200}};
  for (size_t i = 0; i < sizeof scales / sizeof *scales; i++) {
    d = desc(2, 2, 2, TC_U8);
    d.slope = scales[i][0], d.intercept = scales[i][1];
    refused(d, TC_ERROR_INVALID);
  }
  d = desc(2, 2, 2, TC_U8);
  memset(d.direction, 0, sizeof d.direction);
  refused(d, TC_ERROR_INVALID);
  d = desc(2, 2, 2, TC_U8);
  d.direction[4] = 0, d.direction[1] = 1; /* two axes the same way */
  refused(d, TC_ERROR_INVALID);
}

TEST(float_voxels_are_mended) {
  tc_volume_desc d = desc(5, 1, 1, TC_F32);
  g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
  const float in[5] = {NAN, -2, INFINITY, 7, -INFINITY};
  memcpy(tc_volume_voxels(v), in, sizeof in);
  tc_volume_seal(v);
  const float *out = tc_volume_data(v), want[5] = {-2, -2, 7, 7, -2};
  assert_memory_equal(out, want, sizeof want);
  assert_int_equal(tc_volume_statistics(v)->non_finite, 3);
  assert_null(tc_volume_voxels(v)); /* sealed */
}

/* NaN is nothing: no value near it, no count, and no extreme of what is there. */
TEST(nan_is_nothing) {
  static const struct {
    const char *unit;
    float in[6], nothing; /* of the middle one of three NaN; those beside a value have the value */
    double slope, intercept;
  } cases[] = {{"", {-5, NAN, NAN, NAN, 1, 3}, 0, 1, 0},
               {"HU", {-1000, NAN, NAN, NAN, 1, 3}, -1000, 1, 0},
               {"", {2, NAN, NAN, NAN, 4, 3}, 2, 1, 0},
               {"", {2, NAN, NAN, NAN, 4, 3}, 2.5f, 2, -5}};
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    tc_volume_desc d = desc(6, 1, 1, TC_F32);
    d.slope = cases[i].slope, d.intercept = cases[i].intercept;
    strcpy(d.unit, cases[i].unit);
    g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
    memcpy(tc_volume_voxels(v), cases[i].in, sizeof cases[i].in);
    tc_volume_seal(v);
    double value, edges[3];
    uint64_t counts[2];
    const float *voxels = tc_volume_data(v);
    assert_true(voxels[1] == cases[i].in[0] && voxels[2] == cases[i].nothing && voxels[3] == cases[i].in[4]);
    assert_memory_equal(tc_volume_data(tc_volume_gaps(v)), ((const uint8_t[]){0, 1, 1, 1, 0, 0}), 6);
    assert_false(tc_volume_value_at(v, (double[3]){1, 0, 0}, &value));
    assert_false(tc_volume_value_at(v, (double[3]){0.5, 0, 0}, &value));
    assert_true(tc_volume_value_at(v, (double[3]){0, 0, 0}, &value));
    assert_true(tc_volume_value_at(v, (double[3]){4.5, 0, 0}, &value));
    tc_volume_histogram(v, 2, counts, edges);
    assert_int_equal(counts[0] + counts[1], 3);
  }
}

TEST(huge_floats_are_scaled) {
  tc_volume_desc d = desc(3, 1, 1, TC_F32);
  d.slope = 2;
  g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
  const float in[3] = {-3e38f, 0, 3e38f};
  memcpy(tc_volume_voxels(v), in, sizeof in);
  tc_volume_seal(v);
  double value, at[3] = {2, 0, 0};
  assert_true(tc_volume_value_at(v, at, &value));
  assert_true(fabs(value / (2 * (double)3e38f) - 1) < 1e-7);
  const float *out = tc_volume_data(v);
  assert_true(isfinite(out[2] - out[0]));
}

TEST(orientation_and_value) {
  tc_volume_desc d = desc(3, 4, 5, TC_I16);
  d.spacing[0] = 0.5, d.spacing[1] = 2, d.spacing[2] = 3;
  d.origin[0] = 10, d.origin[1] = -20, d.origin[2] = 30;
  const double tilted[9] = {0.8, 0, 0.1, 0.6, 0, 0.2, 0, -1, 0.97}; /* sheared, columns not quite unit: mended */
  memcpy(d.direction, tilted, sizeof tilted);
  d.slope = -2, d.intercept = 100;
  g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
  assert_non_null(v);
  int16_t *p = tc_volume_voxels(v);
  for (int z = 0; z < 5; z++)
    for (int y = 0; y < 4; y++)
      for (int x = 0; x < 3; x++) *p++ = (int16_t)(x + 10 * y + 100 * z);
  tc_volume_seal(v);
  assert_true(tc_volume_statistics(v)->max == 100);
  assert_true(tc_volume_statistics(v)->min == 100 - 2 * 432);
  double index[3] = {1.25, 2.5, 3.75}, lps[3], back[3], value;
  tc_volume_index_to_lps(v, index, lps);
  assert_true(fabs(lps[2] - (30 - 2 * 2.5 + 3 * 3.75 * tc_volume_describe(v)->direction[8])) < 1e-12);
  tc_volume_lps_to_index(v, lps, back);
  for (int k = 0; k < 3; k++) assert_true(fabs(back[k] - index[k]) < 1e-12);
  assert_true(tc_volume_value_at(v, index, &value));
  assert_true(fabs(value - (100 - 2 * (1.25 + 25 + 375))) < 1e-9);
  double outside[3] = {2.01, 0, 0}, edge[3] = {2, 3, 4};
  assert_false(tc_volume_value_at(v, outside, &value));
  double near_edge[3] = {2 + 1e-9, -1e-9, 4 + 1e-4}; /* positions come as decimals: this is a voxel's centre */
  assert_true(tc_volume_value_at(v, near_edge, &value));
  assert_true(value == 100 - 2 * 402);
  assert_true(tc_volume_value_at(v, edge, &value));
  assert_true(fabs(value - (100 - 2 * 432)) < 1e-9);
  uint64_t counts[4], sum = 0;
  double edges[5];
  tc_volume_histogram(v, 4, counts, edges);
  for (int i = 0; i < 4; i++) sum += counts[i];
  assert_int_equal(sum, 60);
}

TEST(flat_axis_is_one_spacing_thick) {
  tc_volume_desc d = desc(4, 1, 1, TC_U8);
  g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
  memcpy(tc_volume_voxels(v), "\1\2\3\4", 4);
  tc_volume_seal(v);
  double lo[3], hi[3], value, inside[3] = {1.5, 0.49, -0.5}, out[3] = {1.5, 0.51, 0};
  tc_volume_index_box(v, lo, hi);
  assert_true(lo[1] == -0.5 && hi[1] == 0.5 && lo[0] == 0 && hi[0] == 3);
  assert_true(tc_volume_value_at(v, inside, &value) && value == 2.5);
  assert_false(tc_volume_value_at(v, out, &value));
}

static bool goes_on_twice(void *user, double fraction) {
  int *asked = user;
  assert_true(fraction >= 0 && fraction < 1);
  return ++*asked <= 2;
}

TEST(a_demo_is_given_up_when_told) {
  g_autoptr(GError) error = NULL;
  int asked = 0;
  assert_null(tc_volume_demo_while("head", goes_on_twice, &asked, &error));
  assert_int_equal(error->code, TC_ERROR_CANCELLED);
  assert_int_equal(asked, 3);
}

TEST(demos_are_made) {
  static const char *const names[] = {"head", "vessels", "marschner-lobb", "bucky"};
  for (int i = 0; i < 4; i++) {
    GError *error = NULL;
    tc_volume *a = tc_volume_demo(names[i], &error), *b = tc_volume_demo(names[i], &error);
    assert_non_null(a);
    assert_memory_equal(tc_volume_data(a), tc_volume_data(b), tc_volume_bytes(a));
    assert_true(tc_volume_statistics(a)->max - tc_volume_statistics(a)->min > 100);
    tc_volume_unref(a);
    tc_volume_unref(b);
  }
  g_autoptr(GError) error = NULL;
  tc_volume *head = tc_volume_demo("head", NULL), *labels = tc_volume_demo("head-labels", NULL);
  const tc_volume_desc *of_head = tc_volume_describe(head), *of_labels = tc_volume_describe(labels);
  assert_memory_equal(of_labels->dims, of_head->dims, sizeof of_head->dims);
  assert_memory_equal(of_labels->origin, of_head->origin, sizeof of_head->origin);
  assert_true(tc_volume_statistics(labels)->min == 0 && tc_volume_statistics(labels)->max == 6);
  size_t voxels = (size_t)of_head->dims[0] * (size_t)of_head->dims[1] * (size_t)of_head->dims[2], bone = 0, dense = 0;
  for (size_t i = 0; i < voxels; i++) {
    bone += ((const uint8_t *)tc_volume_data(labels))[i] == 2;
    dense += ((const uint8_t *)tc_volume_data(labels))[i] == 2 && ((const int16_t *)tc_volume_data(head))[i] > 300;
  }
  assert_true(bone > 200000 && dense > bone * 9 / 10); /* the rest are soft edges */
  tc_volume_unref(head);
  tc_volume_unref(labels);
  assert_null(tc_volume_demo("foot", &error));
  assert_int_equal(error->code, TC_ERROR_NOT_FOUND);
  assert_non_null(strstr(error->message, "demo:head"));
}

TESTS(NULL, NULL)
