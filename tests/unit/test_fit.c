/* What a volume opens with: its values without padding, the body without table, a look that no size changes. */
#include "tests/support/test.h"

#include <glib.h>

#include "renderer/tomocast.h"
#include "renderer/volume/body.h"
#include "renderer/volume/values.h"
#include "tests/support/scoped.h"

#define SIDE 64
#define AIR -1000
#define FLESH 40
#define TABLE 200
#define FOAM -600
#define BONE 900

typedef int16_t (*phantom)(int x, int y, int z);

static tc_volume *filled_as(phantom voxel, double spacing, const char *modality, double window) {
  tc_volume_desc d = {.dims = {SIDE, SIDE, SIDE}, .type = TC_I16, .spacing = {spacing, spacing, spacing},
                      .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1, .window_width = window,
                      .window_center = 0.5 * window};
  strcpy(d.modality, modality);
  tc_volume *v = tc_volume_new(&d, NULL);
  int16_t *p = tc_volume_voxels(v);
  for (int z = 0; z < SIDE; z++)
    for (int y = 0; y < SIDE; y++)
      for (int x = 0; x < SIDE; x++) *p++ = voxel(x, y, z);
  tc_volume_seal(v);
  return v;
}

static tc_volume *filled(phantom voxel, double spacing) { return filled_as(voxel, spacing, "CT", 0); }

static bool within(double x, double y, double cx, double cy, double r) {
  return (x - cx) * (x - cx) + (y - cy) * (y - cy) < r * r;
}

/* A trunk with a lung, in it a nodule, in front of it a bone; beside it an arm; behind it a table with rails. */
static int16_t patient(int x, int y, int z) {
  if (y == 58 || y == 59 || ((x == 4 || x == 60) && y > 48 && y < 60)) return TABLE;
  if (within(x, y, 56, 30, 5)) return FLESH;
  if (!within(x, y, 28, 30, 20)) return AIR;
  if (within(x, y, 28, 14, 3)) return BONE;
  if (!within(x, y, 28, 34, 12)) return FLESH;
  return within(x, y, 28, 34, 2) && z > 20 && z < 24 ? FLESH : -850;
}

static tc_volume *body_of(const tc_volume *volume) {
  tc_fit fit;
  tc_fit_find(&fit, volume);
  return tc_fit_body(&fit, volume, NULL, NULL, NULL);
}

static double value_at(const tc_volume *volume, double x, double y, double z) {
  const double lps[3] = {x, y, z};
  double index[3], value = NAN;
  tc_volume_lps_to_index(volume, lps, index);
  tc_volume_value_at(volume, index, &value);
  return value;
}

TEST(the_table_goes_and_all_else_stays) {
  tc_volume *whole = filled(patient, 1), *body = body_of(whole);
  assert_non_null(body);
  assert_true(value_at(body, 28, 58, 30) != TABLE); /* air, or outside of what is left */
  assert_true(value_at(body, 4, 50, 30) != TABLE);
  static const int kept[][3] = {{28, 14, 30}, {56, 30, 30}, {28, 34, 22}, {28, 34, 40}, {15, 30, 0}};
  for (size_t i = 0; i < sizeof kept / sizeof *kept; i++) {
    const double x = kept[i][0], y = kept[i][1], z = kept[i][2];
    assert_true(value_at(body, x, y, z) == value_at(whole, x, y, z));
  }
  assert_true(tc_volume_bytes(body) < tc_volume_bytes(whole));
  assert_true(tc_volume_statistics(body)->max == tc_volume_statistics(whole)->max); /* so that tables are shared */
  tc_volume_unref(body);
  tc_volume_unref(whole);
}

/* Lies on the table: so does an arm. In front of the lung the chest is as thin as a chest can be. */
static int16_t lying(int x, int y, int z) {
  if (y == 49 || y == 50) return TABLE;
  if (y == 53 || ((x == 1 || x == 62) && y > 49 && y < 54)) return TABLE;
  if (y > 53 && x < 30) return FOAM;
  if (within(x, y, 57, 43, 6)) return within(x, y, 57, 43, 2) ? BONE : FLESH;
  return within(x, y, 28, 30, 20) && !within(x, y, 28, 26, 12) ? FLESH : AIR;
}

TEST(a_table_that_is_touched_goes_too) {
  tc_volume *whole = filled(lying, 1), *body = body_of(whole);
  assert_non_null(body);
  static const int gone[][2] = {{5, 49}, {10, 53}, {28, 53}, {45, 53}, {62, 52}, {20, 56}};
  for (size_t i = 0; i < sizeof gone / sizeof *gone; i++) {
    const double value = value_at(body, gone[i][0], gone[i][1], 30);
    assert_true(isnan(value) || value == AIR);
  }
  for (int y = 0; y < 49; y++)
    for (int x = 0; x < SIDE; x++)
      if (lying(x, y, 30) == FLESH) assert_true(value_at(body, x, y, 30) == FLESH);
  tc_volume_unref(body);
  tc_volume_unref(whole);
}

static int16_t mask(int x, int y, int z) { return within(x, y, 32, 32, 20); }

/* Values without a unit: what lies on a faint board with a rail, and what bears a wide leaf where its board would be. */
static int16_t fainter(int x, int y, int z) {
  const int noise = (x * 7 + y * 5 + z * 3) % 12;
  if (y == 50 || (y > 50 && y < 56 && x == 3)) return (int16_t)(90 + noise);
  return (int16_t)(within(x, y, 30, 28, 18) ? 200 + noise : noise);
}
static int16_t leafy(int x, int y, int z) {
  const int16_t all = fainter(x, 63 - y, z);
  return y == 13 && within(x, z, 30, 30, 28) ? 95 : all > 80 && all < 110 ? 0 : all;
}

TEST(what_lies_on_a_faint_board_is_left_alone_with_it) {
  tc_volume *whole = filled_as(fainter, 1, "", 0), *body = body_of(whole);
  assert_non_null(body);
  static const int gone[][2] = {{10, 50}, {30, 50}, {55, 50}, {3, 53}};
  for (size_t i = 0; i < sizeof gone / sizeof *gone; i++) {
    const double value = value_at(body, gone[i][0], gone[i][1], 30);
    assert_true(isnan(value) || value < 20);
  }
  for (int y = 0; y < 49; y++)
    for (int x = 0; x < SIDE; x++)
      if (fainter(x, y, 30) > 100) assert_true(value_at(body, x, y, 30) == fainter(x, y, 30));
  tc_volume_unref(body);
  tc_volume_unref(whole);
}

TEST(without_units_only_what_is_behind_is_a_table) {
  const phantom all[] = {leafy, mask, fainter};
  const char *const modality[] = {"", "", "MR"};
  for (size_t i = 0; i < sizeof all / sizeof *all; i++) {
    g_autoptr(tc_volume) whole = filled_as(all[i], 1, modality[i], 0);
    assert_null(body_of(whole));
  }
}

static int16_t nobody(int x, int y, int z) { return within(x, y, 32, 32, 20) ? FLESH + (x + y + z) % 400 : AIR; }

TEST(who_lies_on_nothing_is_left_alone) {
  g_autoptr(tc_volume) whole = filled(nobody, 1);
  assert_null(body_of(whole));
}

static bool never(void *user) { return false; }
static bool few(void *user) { return --*(int *)user > 0; }
static bool refused(void *user, uint64_t bytes) {
  *(uint64_t *)user = bytes;
  return false;
}

TEST(it_stops_and_takes_no_memory_unasked) {
  g_autoptr(tc_volume) whole = filled(patient, 1);
  tc_fit fit;
  tc_fit_find(&fit, whole);
  assert_null(tc_fit_body(&fit, whole, never, NULL, NULL));
  int slices = 100; /* past the first walk */
  assert_null(tc_fit_body(&fit, whole, few, NULL, &slices));
  uint64_t bytes = 0;
  assert_null(tc_fit_body(&fit, whole, NULL, refused, &bytes));
  assert_in_range(bytes, 1, tc_volume_bytes(whole));
}

static int16_t noise(int x, int y, int z) { return (x + y + z) % 2 ? FLESH : AIR; }

TEST(too_many_parts_are_not_told_apart) {
  g_autoptr(tc_volume) whole = filled(noise, 1);
  assert_null(body_of(whole));
}

/* Unsigned voxels, padded with one far value, as the bunny is. */
static tc_volume *padded(void) {
  const tc_volume_desc d = {.dims = {SIDE, SIDE, 8}, .type = TC_U16, .spacing = {1, 1, 1},
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1};
  tc_volume *v = tc_volume_new(&d, NULL);
  uint16_t *p = tc_volume_voxels(v);
  for (int i = 0; i < SIDE * SIDE * 8; i++) {
    const int x = i % SIDE, y = i / SIDE % SIDE;
    p[i] = !within(x, y, 32, 32, 30) ? 63536 : (uint16_t)(within(x, y, 32, 32, 15) ? 2000 + i % 100 : i % 100);
  }
  tc_volume_seal(v);
  return v;
}

TEST(padding_counts_for_nothing) {
  g_autoptr(tc_volume) v = padded();
  tc_fit fit;
  tc_fit_find(&fit, v);
  print_message("range %g to %g, parted at %g\n", fit.stretch.low, fit.stretch.high, fit.stretch.middle);
  assert_true(fit.stretch.low == 0 && fit.stretch.high == 2099);
  assert_true(fit.surface > 99 && fit.surface <= 2000);
  g_autoptr(tc_volume) body = tc_fit_body(&fit, v, NULL, NULL, NULL);
  assert_non_null(body);
  for (int i = 0; i < SIDE * SIDE * 8; i++) assert_true(((const uint16_t *)tc_volume_data(body))[i] < 2100);
}

TEST(floats_have_padding_too) {
  const tc_volume_desc d = {.dims = {SIDE, SIDE, 1}, .type = TC_F32, .spacing = {1, 1, 1},
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1};
  g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
  float *p = tc_volume_voxels(v);
  for (int i = 0; i < SIDE * SIDE; i++) p[i] = i % 7 ? (float)(i % 1000) / 1000 : -3.4e28f;
  tc_volume_seal(v);
  tc_values *values = tc_values_of(v);
  double low, high;
  tc_values_range(values, &low, &high);
  print_message("range %g to %g\n", low, high);
  assert_true(low > -0.1 && low < 0.1 && high > 0.9 && high < 1.1);
  tc_values_free(values);
}

/* Of masks both ends are values, not padding. */
TEST(masks_have_none) {
  g_autoptr(tc_volume) v = filled(mask, 1);
  tc_values *values = tc_values_of(v);
  double low, high;
  tc_values_range(values, &low, &high);
  assert_true(low == 0 && high == 1);
  tc_values_free(values);
}

TEST(a_picture_depends_on_no_size) {
  tc_volume *v[2] = {filled(patient, 1), filled(patient, 1000)};
  tc_scene s[2];
  for (int i = 0; i < 2; i++) {
    tc_fit fit;
    tc_fit_find(&fit, v[i]);
    tc_scene_init(&s[i]);
    tc_scene_dress(&s[i], v[i], &fit, true);
    assert_true(s[i].hide_table && s[i].shading.model == TC_SHADING_BLINN_PHONG);
    tc_volume_unref(v[i]);
  }
  const tc_transfer_function *a = &s[0].transfer_function, *b = &s[1].transfer_function;
  assert_string_equal(a->preset, "ct-chest-contrast");
  assert_string_equal(b->preset, a->preset);
  assert_true(fabs(b->unit_distance_mm / a->unit_distance_mm - 1000) < 1e-6);
  assert_memory_equal(a->points, b->points, a->count * sizeof *a->points);
  assert_true(fabs(s[1].camera.position[1] / s[0].camera.position[1] - 1000) < 1e-6);
  for (int i = 0; i < 2; i++) tc_scene_clear(&s[i]);
}

/* Values of MR have no unit: a scan whose receiver was ten times as loud looks the same. */
static int16_t brain(int x, int y, int z) { return within(x, y, 32, 32, 24) ? 150 + (x * y + z) % 90 : (x + y) % 100; }
static int16_t loud_brain(int x, int y, int z) { return 10 * brain(x, y, z); }

TEST(values_without_a_unit_are_fitted) {
  const phantom all[] = {brain, loud_brain};
  double first[2], last[2];
  for (int i = 0; i < 2; i++) {
    g_autoptr(tc_volume) v = filled_as(all[i], 1, "MR", 0);
    tc_fit fit;
    tc_fit_find(&fit, v);
    tc_transfer_function tf = {0};
    assert_string_equal(fit.preset, "mr-default");
    assert_true(tc_transfer_function_fit_preset(&tf, fit.preset, &fit.stretch));
    first[i] = tf.points[0].value, last[i] = tf.points[tf.count - 1].value;
    g_free(tf.points);
  }
  print_message("%g to %g, %g to %g\n", first[0], last[0], first[1], last[1]);
  assert_true(fabs(first[1] / first[0] - 10) < 0.5 && fabs(last[1] / last[0] - 10) < 0.5);
  assert_true(last[0] > 180 && last[0] < 300);
}

/* A file's window that makes the body white is not taken for slices. */
TEST(a_window_that_shows_nothing_is_not_taken) {
  const double width[] = {8, 400};
  for (int i = 0; i < 2; i++) {
    g_autoptr(tc_volume) v = filled_as(brain, 1, "MR", width[i]);
    tc_fit fit;
    tc_fit_find(&fit, v);
    print_message("width %g: %g\n", width[i], fit.windows[TC_MODE_MPR].width);
    assert_true((fit.windows[TC_MODE_MPR].width == width[i]) == (width[i] == 400));
    assert_true(fit.windows[TC_MODE_MPR].center + 0.5 * fit.windows[TC_MODE_MPR].width > 200);
  }
}

/* In a container whose walls are those of the volume. */
static int16_t contained(int x, int y, int z) { return within(x, y, 32, 32, 14) ? 180 + x : 80 + (x + y + z) % 5; }

TEST(what_is_at_the_walls_is_around) {
  g_autoptr(tc_volume) v = filled_as(contained, 1, "", 0);
  tc_fit fit;
  tc_fit_find(&fit, v);
  print_message("from %g on, parted at %g\n", fit.stretch.low, fit.stretch.middle);
  assert_true(fit.stretch.low >= 82 && fit.stretch.low < fit.stretch.middle);
}

static int16_t skull(int x, int y, int z) {
  const double r = hypot(hypot(x - 32, y - 32), z - 32);
  return r > 26 ? AIR : r > 20 ? BONE : FLESH;
}

TEST(heads_and_trunks_are_told_apart_by_bone) {
  g_autoptr(tc_volume) v = filled(skull, 1);
  tc_fit fit;
  tc_fit_find(&fit, v);
  assert_string_equal(fit.preset, "ct-head");
  assert_true(tc_preset_named(fit.preset)->lit);
}

TEST(a_maximum_has_grey_in_it) {
  const phantom all[] = {patient, skull};
  for (size_t i = 0; i < 2; i++) {
    tc_volume *v = filled(all[i], 1), *body = body_of(v);
    tc_fit fit;
    tc_fit_find(&fit, v);
    tc_fit_windows(&fit, v, body);
    const double white = fit.windows[TC_MODE_MIP].center + 0.5 * fit.windows[TC_MODE_MIP].width;
    int pixels = 0, clipped = 0;
    for (int x = 0; x < SIDE; x++)
      for (int z = 0; z < SIDE; z++) {
        double most = AIR;
        for (int y = 0; y < SIDE; y++) most = fmax(most, all[i](x, y, z) == TABLE ? AIR : all[i](x, y, z));
        pixels += most > -300;
        clipped += most >= white;
      }
    print_message("%.0f %% of the body is white from %g on\n", 100.0 * clipped / pixels, white);
    assert_true(clipped <= 0.3 * pixels);
    tc_volume_unref(body);
    tc_volume_unref(v);
  }
}

/* A few slices are looked at along their normal: so is what their windows come from. */
TEST(windows_are_those_of_the_first_view) {
  const tc_volume_desc d = {.dims = {SIDE, SIDE, 4}, .type = TC_I16, .spacing = {1, 1, 1},
                            .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .slope = 1, .modality = "MR"};
  g_autoptr(tc_volume) v = tc_volume_new(&d, NULL);
  int16_t *p = tc_volume_voxels(v);
  for (int i = 0; i < SIDE * SIDE * 4; i++) p[i] = within(i % SIDE, i / SIDE % SIDE, 32, 32, 20) ? 200 + i % 50 : i % 20;
  tc_volume_seal(v);
  tc_fit fit;
  tc_fit_find(&fit, v);
  tc_fit_windows(&fit, v, NULL);
  const double white = fit.windows[TC_MODE_AVERAGE].center + 0.5 * fit.windows[TC_MODE_AVERAGE].width;
  print_message("white from %g on\n", white);
  assert_true(white > 200 && white < 250);
}

TESTS(NULL, NULL)
