/* The geometry of DICOM stacks: order, spacing, tilt, varying steps, gaps, segmentations. */
#include "tests/support/test.h"

#include "renderer/import/helper/dicom_stack.h"

enum { MOST = 64 };

/* n axial pictures from z = 10, `step` mm apart, in file order. */
static void axial(tc_dicom_slice *s, int n, double step) {
  memset(s, 0, sizeof *s * (size_t)n);
  for (int i = 0; i < n; i++) {
    s[i] = (tc_dicom_slice){.source = (uint32_t)i,
                            .instance = i + 1,
                            .rows = 4,
                            .columns = 5,
                            .has_position = true,
                            .has_orientation = true,
                            .has_spacing = true,
                            .position = {-1, -2, 10 + step * i},
                            .orientation = {1, 0, 0, 0, 1, 0},
                            .spacing = {0.5, 0.75},
                            .thickness = 9};
  }
}

static void close_to(double a, double b) {
  if (!(fabs(a - b) < 1e-9)) fail_msg("%.17g is not %.17g", a, b);
}

/* All pictures given. */
static bool make(const tc_dicom_slice *s, size_t n, tc_dicom_stack *stack, GError **error) {
  uint32_t all[MOST];
  for (size_t i = 0; i < n; i++)
    all[i] = (uint32_t)i;
  return tc_dicom_stack_make(s, all, n, stack, error);
}

TEST(sorts_by_position) {
  tc_dicom_slice s[7], shuffled[7];
  static const int order[7] = {3, 0, 6, 1, 5, 2, 4};
  tc_dicom_stack stack;
  axial(s, 7, 2.5);
  for (int i = 0; i < 7; i++)
    shuffled[i] = s[order[i]];
  assert_true(make(shuffled, 7, &stack, NULL));
  assert_int_equal(stack.count, 7);
  for (int i = 0; i < 7; i++) {
    assert_int_equal(shuffled[stack.items[i].slice].source, i);
    assert_int_equal(stack.items[i].layer, i);
  }
  assert_int_equal(stack.dims[0], 5);
  assert_int_equal(stack.dims[1], 4);
  assert_int_equal(stack.dims[2], 7);
  close_to(stack.spacing[0], 0.5);
  close_to(stack.spacing[1], 0.75);
  close_to(stack.spacing[2], 2.5); /* from positions, not the 9 mm thickness */
  close_to(stack.origin[2], 10);
  assert_string_equal(stack.note, "");
  tc_dicom_stack_finish(&stack);
}

/* Whatever the orientation, the grid must give back every slice's own position. */
TEST(positions_come_back) {
  static const double planes[4][6] = {
      {1, 0, 0, 0, 1, 0}, {0, 1, 0, 0, 0, -1}, {-1, 0, 0, 0, 1, 0}, {0.6, 0.8, 0, -0.48, 0.36, 0.8}};
  for (int p = 0; p < 4; p++) {
    tc_dicom_slice s[9];
    tc_dicom_stack stack;
    const double *o = planes[p];
    double n[3] = {o[1] * o[5] - o[2] * o[4], o[2] * o[3] - o[0] * o[5], o[0] * o[4] - o[1] * o[3]};
    axial(s, 9, 1);
    for (int i = 0; i < 9; i++) {
      memcpy(s[i].orientation, o, sizeof s[i].orientation);
      for (int k = 0; k < 3; k++)
        s[i].position[k] = 30 + k + n[k] * 1.5 * i + 0.4 * o[3 + k] * i; /* tilted: sheared */
    }
    assert_true(make(s, 9, &stack, NULL));
    double length = 0;
    for (int k = 0; k < 3; k++)
      length += stack.direction[3 * k + 2] * stack.direction[3 * k + 2];
    close_to(length, 1);
    close_to(stack.spacing[2], sqrt(1.5 * 1.5 + 0.4 * 0.4));
    for (size_t i = 0; i < stack.count; i++)
      for (int k = 0; k < 3; k++)
        close_to(stack.origin[k] + stack.direction[3 * k + 2] * stack.spacing[2] * stack.items[i].layer,
                 s[stack.items[i].slice].position[k]);
    for (int k = 0; k < 3; k++) {
      close_to(stack.direction[3 * k], o[k]);
      close_to(stack.direction[3 * k + 1], o[3 + k]);
    }
    tc_dicom_stack_finish(&stack);
  }
}

/* What layer z of a mixed stack shows where every slice shows its own height. */
static double height(const tc_dicom_slice *s, const tc_dicom_stack *stack, int z) {
  const tc_dicom_mix *m = &stack->mix[z];
  double below = s[stack->items[m->item].slice].position[2], above = s[stack->items[m->item + 1].slice].position[2];
  return (1 - (double)m->part) * below + (double)m->part * above;
}

static void check_heights(const tc_dicom_slice *s, const tc_dicom_stack *stack) {
  assert_non_null(stack->mix);
  for (int z = 0; z < stack->dims[2]; z++) {
    double want = stack->origin[2] + stack->direction[8] * stack->spacing[2] * z;
    if (!(fabs(height(s, stack, z) - want) < 1e-5)) fail_msg("layer %d shows %g, lies at %g", z, height(s, stack, z), want);
  }
}

TEST(one_missing_slice_is_bridged) {
  tc_dicom_slice s[10];
  tc_dicom_stack stack;
  axial(s, 10, 3);
  s[6] = s[9]; /* slice 7 is gone */
  assert_true(make(s, 9, &stack, NULL));
  assert_int_equal(stack.dims[2], 10);
  assert_int_equal(stack.bridged, 7);
  close_to(stack.spacing[2], 3);
  check_heights(s, &stack);
  for (int z = 0; z < 10; z++)
    if (z != 6) assert_true(stack.mix[z].part == 0 || stack.mix[z].part == 1); /* what is there stays as it is */
  assert_non_null(strstr(stack.note, "1 missing slice bridged"));
  assert_non_null(strstr(stack.note, "layer 7 of 10"));
  tc_dicom_stack_finish(&stack);
}

TEST(more_missing_slices_are_an_error) {
  tc_dicom_slice s[12];
  tc_dicom_stack stack;
  GError *error = NULL;
  axial(s, 12, 3);
  s[3] = s[10];
  s[6] = s[11]; /* slices 4 and 7 are gone */
  assert_false(make(s, 10, &stack, &error));
  assert_int_equal(error->code, TC_ERROR_FORMAT);
  assert_non_null(strstr(error->message, "2 slices are missing at 2 places, the first after slice 3"));
  g_clear_error(&error);
  axial(s, 8, 1.5);
  for (int i = 4; i < 8; i++)
    s[i].position[2] += 30; /* nothing is made up for a gap of 20 slices that is no whole number of steps */
  s[4].position[2] -= 0.3;
  assert_false(make(s, 8, &stack, &error));
  assert_non_null(strstr(error->message, "missing after slice 4"));
  g_error_free(error);
}

TEST(small_differences_keep_the_mean) {
  tc_dicom_slice s[10];
  tc_dicom_stack stack;
  axial(s, 10, 3);
  s[4].position[2] += 0.15; /* 5 %: a note */
  assert_true(make(s, 10, &stack, NULL));
  close_to(stack.spacing[2], 3);
  assert_null(stack.mix);
  assert_non_null(strstr(stack.note, "differ"));
  tc_dicom_stack_finish(&stack);
}

/* Steps that vary: every layer shows what lies at its height, the first and the last slice stay where they are. */
TEST(varying_steps_are_resampled) {
  static const double steps[4][7] = {{3, 3, 3.75, 2.25, 3, 3, 3}, /* one slice off its place */
                                     {2.5, 2.5, 2.5, 5, 5, 5, 5}, /* thin, then thick: nothing is missing */
                                     {4.22, 4.22, 4.22, 1.14, 7.38, 7.38, 7.38},
                                     {1, 1.7, 2.1, 1.3, 0.9, 1.6, 2}};
  for (int k = 0; k < 4; k++)
    for (int tilt = 0; tilt < 2; tilt++) {
      tc_dicom_slice s[8];
      tc_dicom_stack stack;
      GError *error = NULL;
      axial(s, 8, 0);
      for (int i = 0; i < 8; i++) {
        s[i].position[2] = i ? s[i - 1].position[2] + steps[k][i - 1] : 10;
        if (tilt) memcpy(s[i].orientation, (double[]){1, 0, 0, 0, 0.96, -0.28}, sizeof s[i].orientation);
      }
      if (!make(s, 8, &stack, &error)) fail_msg("%s", error->message);
      check_heights(s, &stack);
      close_to(stack.origin[2] + stack.spacing[2] * (stack.dims[2] - 1), s[7].position[2]);
      close_to(stack.direction[8], 1);
      assert_true(stack.spacing[2] <= 1e-6 + fmin(fmin(steps[k][3], steps[k][0]), steps[k][4]));
      assert_int_equal(stack.bridged, 0);
      assert_non_null(strstr(stack.note, "8 slices resampled to"));
      assert_true(!tilt == !strstr(stack.note, "gantry tilt: slices are stacked 16.3 degrees"));
      tc_dicom_stack_finish(&stack);
    }
}

TEST(shared_positions_are_no_stack) {
  tc_dicom_slice s[6];
  tc_dicom_stack stack;
  g_autoptr(GError) error = NULL;
  axial(s, 6, 3);
  s[3].position[2] = s[2].position[2];
  assert_false(make(s, 6, &stack, &error));
  assert_non_null(strstr(error->message, "share a position"));
}

TEST(off_the_line) {
  tc_dicom_slice s[10];
  tc_dicom_stack stack;
  g_autoptr(GError) error = NULL;
  axial(s, 10, 3);
  s[5].position[0] += 20;
  assert_false(make(s, 10, &stack, &error));
  assert_non_null(strstr(error->message, "straight line"));
}

TEST(without_positions) {
  tc_dicom_slice s[4];
  tc_dicom_stack stack;
  axial(s, 4, 3);
  for (int i = 0; i < 4; i++) {
    s[i].has_position = s[i].has_orientation = s[i].has_spacing = false;
    s[i].instance = 4 - i;
    s[i].thickness = 0;
  }
  assert_true(make(s, 4, &stack, NULL));
  assert_int_equal(stack.dims[2], 4);
  assert_int_equal(s[stack.items[0].slice].instance, 1);
  for (int k = 0; k < 3; k++)
    close_to(stack.spacing[k], 1);
  assert_non_null(strstr(stack.note, "1 mm"));
  tc_dicom_stack_finish(&stack);
}

TEST(one_slice) {
  tc_dicom_slice s[1];
  tc_dicom_stack stack;
  axial(s, 1, 1);
  assert_true(make(s, 1, &stack, NULL));
  assert_int_equal(stack.dims[2], 1);
  close_to(stack.spacing[2], 9);
  close_to(stack.direction[8], 1);
  tc_dicom_stack_finish(&stack);
}

TEST(segmentations_may_have_gaps) {
  tc_dicom_slice s[5];
  tc_dicom_stack stack;
  static const double at[5] = {0, 2.5, 2.5, 7.5, 10};
  axial(s, 5, 0);
  for (int i = 0; i < 5; i++) {
    s[i].position[2] = at[i];
    s[i].sparse = true;
    s[i].segment = i == 2 ? 2 : 1;
    s[i].between = 2.5;
  }
  assert_true(make(s, 5, &stack, NULL));
  static const uint32_t layers[5] = {0, 1, 1, 3, 4};
  assert_int_equal(stack.dims[2], 5);
  assert_int_equal(stack.count, 5);
  for (int i = 0; i < 5; i++)
    assert_int_equal(stack.items[i].layer, layers[i]);
  close_to(stack.spacing[2], 2.5);
  assert_non_null(strstr(stack.note, "1 slices"));
  tc_dicom_stack_finish(&stack);
}

TEST(nonsense_is_no_crash) {
  tc_dicom_slice s[MOST];
  uint32_t seed = 1;
  for (int round = 0; round < 2000; round++) {
    int n = 1 + round % MOST;
    axial(s, n, 1);
    for (int i = 0; i < n; i++)
      for (int k = 0; k < 3; k++) {
        seed = seed * 1664525u + 1013904223u;
        static const double odd[8] = {0, 1e300, -1e300, 1e-300, 3, -3, 1e9, 0.5};
        s[i].position[k] = odd[seed >> 29];
        s[i].sparse = round & 1;
      }
    tc_dicom_stack stack;
    if (!make(s, (size_t)n, &stack, NULL)) continue;
    assert_true(stack.count >= 1);
    for (size_t i = 0; i < stack.count; i++)
      assert_true(stack.items[i].layer < (uint32_t)stack.dims[2]);
    tc_dicom_stack_finish(&stack);
  }
}

TESTS(NULL, NULL)
