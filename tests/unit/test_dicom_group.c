/* Which pictures make a volume: keys, copies, turns, pieces; nothing is ever mixed. */
#include "tests/support/test.h"

#include "renderer/import/helper/dicom_group.h"

enum { MOST = 128 };

static tc_dicom_slice s[MOST];
static int n;

/* Adds `count` axial pictures from z, `step` mm apart; instances go on. Gives the first. */
static tc_dicom_slice *add(int count, double z, double step) {
  tc_dicom_slice *first = s + n;
  for (int i = 0; i < count; i++, n++)
    s[n] = (tc_dicom_slice){.source = (uint32_t)n,
                            .instance = n + 1,
                            .uid = (uint64_t)n + 1,
                            .rows = 4,
                            .columns = 5,
                            .has_position = true,
                            .has_orientation = true,
                            .has_spacing = true,
                            .position = {-1, -2, z + step * i},
                            .orientation = {1, 0, 0, 0, 1, 0},
                            .spacing = {0.5, 0.75}};
  return first;
}

static void set_key(tc_dicom_slice *first, int count, tc_dicom_key key, double value) {
  for (int i = 0; i < count; i++) first[i].keys[key] = value;
}

/* The volumes must have these numbers of pictures, and pictures of one key value each. */
static void check(const size_t *counts, size_t wanted, tc_dicom_key key) {
  tc_dicom_groups groups;
  tc_dicom_groups_make(s, (size_t)n, &groups);
  assert_int_equal(groups.count, wanted);
  for (size_t g = 0; g < wanted; g++) {
    const tc_dicom_group *group = &groups.list[g];
    if (group->count != counts[g]) fail_msg("volume %zu has %zu pictures, not %zu", g + 1, group->count, counts[g]);
    assert_int_equal(group->places, counts[g]);
    assert_false(group->tangled);
    for (size_t i = 1; i < group->count && key < TC_DICOM_KEY_COUNT; i++)
      assert_true(s[group->slices[i]].keys[key] == s[group->slices[0]].keys[key]);
  }
  tc_dicom_groups_finish(&groups);
}

#define CHECK(key, ...)                                                                                                \
  check((const size_t[]){__VA_ARGS__}, sizeof((const size_t[]){__VA_ARGS__}) / sizeof(size_t), key)

static int set_up(void **state) {
  n = 0;
  return 0;
}

/* Where one time point lacks a slice, the next one's must not take its place. */
TEST_WITH(keys_never_mix, set_up, NULL) {
  for (tc_dicom_key key = 0; key < TC_DICOM_KEY_COUNT; key++) {
    n = 0;
    set_key(add(6, 0, 5), 6, key, 1);
    set_key(add(3, 0, 5), 3, key, 2);
    set_key(add(2, 20, 5), 2, key, 2);
    set_key(add(6, 0, 5), 6, key, 3);
    for (int i = 0; i < n; i++) s[i].instance = 1 + i % 3; /* no help from these */
    CHECK(key, 6, 5, 6);
  }
}

TEST_WITH(half_steps_are_two_volumes, set_up, NULL) {
  set_key(add(9, 0, 4), 9, TC_DICOM_KEY_ACQUISITION, 1);
  set_key(add(8, 2, 4), 8, TC_DICOM_KEY_ACQUISITION, 2);
  CHECK(TC_DICOM_KEY_ACQUISITION, 9, 8);
}

/* A scan made piece by piece: every other key of its kind is one volume, and the two of a tilted CT with another image
 * type at each half. */
TEST_WITH(pieces_in_a_row_are_one, set_up, NULL) {
  for (int i = 0; i < 14; i++) set_key(add(1, 4.22 * i, 0), 1, TC_DICOM_KEY_ACQUISITION, i + 1);
  set_key(s, 14, TC_DICOM_KEY_IMAGE_TYPE, 99);
  for (int i = 0; i < 14; i++) set_key(add(1, 56 + 7.38 * i, 0), 1, TC_DICOM_KEY_ACQUISITION, 15 + i / 2);
  CHECK(TC_DICOM_KEY_COUNT, 28);
}

/* The same twice: acquisitions run on through both. */
TEST_WITH(pieces_of_two_time_points, set_up, NULL) {
  for (int i = 0; i < 20; i++) set_key(add(1, 3 * (i % 10), 0), 1, TC_DICOM_KEY_ACQUISITION, i + 1);
  CHECK(TC_DICOM_KEY_COUNT, 10, 10);
}

TEST_WITH(pieces_far_apart_are_two, set_up, NULL) {
  set_key(add(10, 0, 2), 10, TC_DICOM_KEY_ACQUISITION, 1);
  set_key(add(8, 100, 2), 8, TC_DICOM_KEY_ACQUISITION, 2);
  CHECK(TC_DICOM_KEY_ACQUISITION, 10, 8);
}

TEST_WITH(turns_part_what_keys_do_not, set_up, NULL) {
  for (int t = 0; t < 3; t++) add(6, 0, 5);
  CHECK(TC_DICOM_KEY_COUNT, 6, 6, 6);
  tc_dicom_groups groups;
  tc_dicom_groups_make(s, (size_t)n, &groups);
  for (uint32_t i = 0; i < 18; i++) assert_int_equal(groups.list[i / 6].slices[i % 6], i);
  tc_dicom_groups_finish(&groups);
  s[8] = s[17]; /* the second lacks a slice: runs still tell */
  n = 17;
  CHECK(TC_DICOM_KEY_COUNT, 6, 5, 6);
}

TEST_WITH(tangled_pictures_are_said, set_up, NULL) {
  for (int t = 0; t < 3; t++) add(6, 0, 5);
  n = 17;
  for (int i = 0; i < n; i++) s[i].instance = (i * 7) % 17;
  tc_dicom_groups groups;
  tc_dicom_groups_make(s, (size_t)n, &groups);
  assert_int_equal(groups.count, 1);
  assert_true(groups.list[0].tangled);
  assert_int_equal(groups.list[0].places, 6);
  tc_dicom_groups_finish(&groups);
}

TEST_WITH(copies_are_one, set_up, NULL) {
  add(6, 0, 5);
  s[6] = s[2];
  s[7] = s[2];
  n = 8;
  tc_dicom_groups groups;
  tc_dicom_groups_make(s, (size_t)n, &groups);
  assert_int_equal(groups.count, 1);
  assert_int_equal(groups.list[0].count, 6);
  assert_int_equal(groups.copies, 2);
  tc_dicom_groups_finish(&groups);
  n = 6;
  for (int i = 0; i < 6; i++) s[i].uid = 5; /* a writer with one UID for all */
  CHECK(TC_DICOM_KEY_COUNT, 6);
}

TEST_WITH(segmentations_stay_together, set_up, NULL) {
  add(6, 0, 5);
  add(6, 0, 5);
  for (int i = 0; i < 12; i++) s[i].sparse = true;
  tc_dicom_groups groups;
  tc_dicom_groups_make(s, 12, &groups);
  assert_int_equal(groups.count, 1);
  assert_int_equal(groups.list[0].count, 12);
  assert_int_equal(groups.list[0].places, 6);
  assert_false(groups.list[0].tangled);
  tc_dicom_groups_finish(&groups);
}

static int chosen(unsigned wanted, const char *trouble) {
  tc_dicom_groups groups;
  g_autoptr(GError) error = NULL;
  tc_dicom_groups_make(s, (size_t)n, &groups);
  int g = tc_dicom_groups_choose(&groups, wanted, &error);
  assert_true((g < 0) == (trouble != NULL));
  if (trouble && !strstr(error->message, trouble)) fail_msg("%s", error->message);
  tc_dicom_groups_finish(&groups);
  return g;
}

/* A few slices of a series are never opened unasked. */
TEST_WITH(a_piece_is_opened_only_for_who_asks, set_up, NULL) {
  static const double sagittal[6] = {0, 1, 0, 0, 0, -1};
  add(2, 0, 3);
  for (int i = 0; i < 2; i++) {
    memcpy(s[i].orientation, sagittal, sizeof sagittal);
    s[i].position[0] = 3 * i;
  }
  add(6, 0, 3);
  s[7].rows = 99;
  assert_int_equal(chosen(0, NULL), 1); /* 5 of 8 */
  assert_int_equal(chosen(1, NULL), 0);
  assert_int_equal(chosen(9, "no volume 9; the series holds 3"), -1);
  for (int i = 2; i < 8; i++) s[i].rows = 4 + i;
  assert_int_equal(chosen(0, "the largest holds 2 of its 8 slices; choose one by #volume=1 to #volume=7"), -1);
  assert_int_equal(chosen(7, NULL), 6);
}

TEST_WITH(volumes_are_named, set_up, NULL) {
  set_key(add(4, 0, 5), 4, TC_DICOM_KEY_ECHO_TIME, 90);
  set_key(add(4, 0, 5), 4, TC_DICOM_KEY_ECHO_TIME, 10.5);
  tc_dicom_groups groups;
  tc_dicom_groups_make(s, 8, &groups);
  assert_string_equal(groups.list[0].what, "echo time 10.5 ms");
  assert_string_equal(groups.list[1].what, "echo time 90 ms");
  tc_dicom_groups_finish(&groups);
}

/* Whatever comes: every picture is in one volume at most, and none is invented. */
TEST_WITH(nonsense_is_no_crash, set_up, NULL) {
  uint32_t seed = 1;
  for (int round = 0; round < 2000; round++) {
    static const double odd[8] = {0, 1e300, -1e300, 1e-300, 3, -3, 1e9, 0.5};
    bool seen[MOST] = {false};
    n = 0;
    add(1 + round % 64, 0, 1);
    for (int i = 0; i < n; i++)
      for (int k = 0; k < 3; k++) {
        seed = seed * 1664525u + 1013904223u;
        s[i].position[k] = odd[seed >> 29];
        s[i].keys[(seed >> 20) % TC_DICOM_KEY_COUNT] = odd[(seed >> 24) & 7];
        s[i].uid = (seed >> 16) & 15;
        s[i].has_position = round % 3;
      }
    tc_dicom_groups groups;
    tc_dicom_groups_make(s, (size_t)n, &groups);
    size_t total = groups.copies;
    for (size_t g = 0; g < groups.count; g++)
      for (size_t i = 0; i < groups.list[g].count; i++, total++) {
        assert_true(groups.list[g].slices[i] < (uint32_t)n && !seen[groups.list[g].slices[i]]);
        seen[groups.list[g].slices[i]] = true;
      }
    assert_int_equal(total, n);
    tc_dicom_groups_finish(&groups);
  }
}

TESTS(NULL, NULL)
