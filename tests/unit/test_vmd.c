/* Run-length voxel models: from volumes and back, files and what is wrong with them. */
#include "tests/support/test.h"
#include <float.h>
#include <zlib.h>

#include "renderer/splat/normal.h"
#include "renderer/splat/splats.h"
#include "renderer/splat/vmd.h"
#include "tests/support/scoped.h"

static const tc_volume_desc grid = {.dims = {3, 2, 70},
                                    .type = TC_I16,
                                    .spacing = {1, 2, 0.5},
                                    .origin = {-10, 20, 30},
                                    .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                    .slope = 2,
                                    .intercept = -1000,
                                    .modality = "CT",
                                    .unit = "HU"};

static tc_volume *volume_of(const tc_volume_desc *desc, int (*value)(int x, int y, int z)) {
  tc_volume *v = tc_volume_new(desc, NULL);
  const int *n = desc->dims;
  for (int i = 0; i < n[0] * n[1] * n[2]; i++) {
    int a = value(i % n[0], i / n[0] % n[1], i / n[0] / n[1]);
    if (desc->type == TC_I16)
      ((int16_t *)tc_volume_voxels(v))[i] = (int16_t)a;
    else
      ((uint8_t *)tc_volume_voxels(v))[i] = (uint8_t)a;
  }
  tc_volume_seal(v);
  return v;
}

/* Two columns: (1,0) with runs 2..3 and 66..69, (2,1) with 0. */
static int few(int x, int y, int z) {
  if (x == 1 && y == 0 && (z == 2 || z == 3 || z >= 66)) return 700 + z;
  return x == 2 && y == 1 && z == 0 ? 900 : 0;
}

static tc_vmd *few_model(const char *attributes) {
  tc_volume *v = volume_of(&grid, few);
  tc_vmd *m = tc_vmd_of_volume(v, &(tc_vmd_options){.low = 300, .high = 3000, .attributes = attributes}, NULL, NULL);
  tc_volume_unref(v);
  assert_non_null(m);
  return m;
}

TEST(columns_runs_and_voxels_are_found) {
  tc_vmd *m = few_model("value");
  assert_int_equal(m->voxels, 7);
  assert_int_equal(m->runs, 3);
  assert_int_equal(m->columns, 2);
  assert_null(tc_vmd_column(m, 0, 0));
  assert_null(tc_vmd_column(m, -1, 0));
  assert_null(tc_vmd_column(m, 3, 5));
  const tc_vmd_attribute *value = tc_vmd_attribute_named(&m->head, "value");
  for (int z = -1; z < 71; z++)
    for (int y = 0; y < 2; y++)
      for (int x = 0; x < 3; x++) {
        const uint8_t *record = tc_vmd_voxel(m, x, y, z);
        int wanted = z < 0 || z > 69 ? 0 : few(x, y, z);
        assert_true((record != NULL) == (wanted != 0));
        if (record) assert_float_equal(tc_vmd_number(value, record), wanted, 0);
      }
  tc_vmd_free(m);
}

static void sign(GByteArray *file) {
  uint32_t sum = (uint32_t)crc32_z(0, file->data, file->len - 4);
  memcpy(file->data + file->len - 4, &sum, 4);
}

static void expect_sum(const GByteArray *file, const char *wanted) {
  g_autofree char *sum = g_compute_checksum_for_data(G_CHECKSUM_SHA256, file->data, file->len);
  assert_string_equal(sum, wanted);
}

/* The page VMD.md shows these bytes. */
TEST(bytes_of_version_2_stay) {
  g_autoptr(tc_vmd) m = few_model("value");
  g_autoptr(GByteArray) file = tc_vmd_encode(m, false, NULL);
  static const uint8_t body[] = {17, 0,    0, 5, 2 << 2, 2, 0xbe, 2, 0xbf,       2, 4 << 2, 62, 0xfe,
                                 2,  0xff, 2, 0, 3,      1, 3,    0, 1 << 2 | 1, 0, 0x84,   3,  0};
  assert_int_equal(file->len, 240 + 20 + sizeof body + 4);
  assert_memory_equal(file->data + 260, body, sizeof body);
  expect_sum(file, "f4a3918eb1def4149971ae683f6a3ee33750361540102879160e59105857d5ee");
}

TEST(version_1_is_read_and_written_as_it_was) {
  g_autoptr(tc_vmd) m = few_model("value");
  g_autoptr(GByteArray) file = tc_vmd_encode(m, false, NULL);
  static const uint8_t body[] = {18,   0, 0, 6, 2, 2, 0xbe, 2, 0xbf, 2, 62,   4, 0xfe, 2,
                                 0xff, 2, 0, 3, 1, 3, 0,    0, 0,    1, 0x84, 3, 0,    0};
  g_byte_array_set_size(file, 260);
  g_byte_array_append(file, body, sizeof body);
  g_byte_array_append(file, (const guint8[4]){0}, 4);
  file->data[4] = 1, file->data[48] = file->data[56] = sizeof body;
  sign(file);
  expect_sum(file, "aa47c254581026a12ca662bfbb55d74a10017b911e4dde1d6f62e7788dbd5c60");
  tc_vmd *back = tc_vmd_decode(file->data, file->len, NULL);
  assert_non_null(back);
  for (int i = 0; i < 3 * 2 * 70; i++) {
    const uint8_t *a = tc_vmd_voxel(m, i % 3, i / 3 % 2, i / 6), *b = tc_vmd_voxel(back, i % 3, i / 3 % 2, i / 6);
    assert_true(a && b ? memcmp(a, b, 2) == 0 : a == b);
  }
  for (int packed = 0; packed < 2; packed++) {
    g_autoptr(GByteArray) again = tc_vmd_encode(back, packed, NULL);
    if (!packed) assert_memory_equal(again->data, file->data, file->len);
    g_autoptr(tc_vmd) third = tc_vmd_decode(again->data, again->len, NULL);
    assert_non_null(third);
    assert_memory_equal(third->bytes, back->bytes, tc_vmd_start(back, back->columns));
  }
  tc_vmd_free(back);
  file->data[270] = 0;
  sign(file);
  assert_null(tc_vmd_decode(file->data, file->len, NULL)); /* runs that touch */
}

/* Two labels along z, the second from another z on in each column; the last column with a voxel of a third. */
static int parts(int x, int y, int z) { return x == 2 && z == 50 ? 3 : z < 20 + 3 * x + y ? 1 : 2; }

TEST(equal_records_are_kept_once) {
  g_autoptr(tc_volume) v = volume_of(&grid, parts);
  tc_vmd *m =
      tc_vmd_of_volume(v, &(tc_vmd_options){.low = 1, .high = 3, .labels = true, .attributes = "label"}, NULL, NULL);
  assert_int_equal(m->voxels, 0); /* 2 v - 1000 is nowhere in 1 .. 3 */
  tc_vmd_free(m);
  m = tc_vmd_of_volume(v, &(tc_vmd_options){.low = -1000, .high = 0, .labels = true, .attributes = "label"}, NULL, NULL);
  assert_int_equal(m->voxels, 3 * 2 * 70);
  for (int i = 0; i < 3 * 2 * 70; i++) {
    const uint8_t *record = tc_vmd_voxel(m, i % 3, i / 3 % 2, i / 6);
    assert_float_equal(tc_vmd_number(&m->head.attributes[0], record), parts(i % 3, i / 3 % 2, i / 6), 0);
  }
  assert_int_equal(tc_vmd_start(m, 1), 4 + 5 + 1); /* two runs of one record, the second of 50 voxels */
  tc_vmd_free(m);
  m = tc_vmd_of_volume(v, &(tc_vmd_options){.low = -INFINITY, .high = -999, .attributes = "user"}, NULL, NULL);
  assert_int_equal(m->voxels, 0);
  tc_vmd_free(m);
  m = tc_vmd_of_volume(v, &(tc_vmd_options){.low = -1000, .high = -997, .attributes = "user"}, NULL, NULL);
  assert_int_equal(tc_vmd_start(m, 1), 2 + 1); /* one run, as before it: zeros */
  tc_vmd_free(m);
}

static int noise(int x, int y, int z) {
  uint32_t h = (uint32_t)x * 73856093u ^ (uint32_t)y * 19349663u ^ (uint32_t)z * 83492791u;
  h = (h ^ h >> 13) * 1274126177u;
  return (int)((h >> 16) % 200);
}

static const tc_volume_desc noisy = {.dims = {37, 21, 130},
                                     .type = TC_U8,
                                     .spacing = {1, 1, 1},
                                     .slope = -1,
                                     .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                                     .intercept = 255};

static void expect_same(const tc_vmd *a, const tc_vmd *b) {
  assert_int_equal(a->voxels, b->voxels);
  assert_int_equal(a->runs, b->runs);
  assert_int_equal(a->columns, b->columns);
  for (uint32_t c = 0; c <= a->columns; c++)
    assert_int_equal(tc_vmd_start(a, c), tc_vmd_start(b, c));
  assert_memory_equal(a->bytes, b->bytes, tc_vmd_start(a, a->columns));
  assert_memory_equal(a->first, b->first, sizeof a->first);
  assert_memory_equal(a->size, b->size, sizeof a->size);
  assert_int_equal(a->head.record_bytes, b->head.record_bytes);
  assert_int_equal(a->head.n_palette, b->head.n_palette);
  assert_memory_equal(a->head.palette, b->head.palette, sizeof a->head.palette);
  assert_memory_equal(a->head.grid.origin, b->head.grid.origin, sizeof a->head.grid.origin);
  assert_float_equal(a->head.grid.slope, b->head.grid.slope, 0);
}

/* Stretches of equal values, some of one voxel. */
static int stretches(int x, int y, int z) {
  const int n = noise(x, y, z);
  return n < 20 ? n : 60 + noise(x, 0, z / (2 + y % 9)) % 5 * 30;
}

/* Whatever the threads, packed or not, all comes back: of a noise, of stretches, of columns too long for short offsets.
 */
TEST(models_survive_a_file) {
  tc_volume_desc deep = noisy;
  memcpy(deep.dims, (int[]){17, 2, 3000}, sizeof deep.dims);
  tc_volume *volumes[] = {volume_of(&noisy, noise), volume_of(&noisy, stretches), volume_of(&deep, noise)};
  tc_pool *pool = tc_pool_new(3, NULL);
  const tc_vmd_options cases[] = {{.low = 100, .high = 155, .attributes = "value,normal,user"},
                                  {.low = -INFINITY, .high = INFINITY},
                                  {.low = -INFINITY, .high = INFINITY, .attributes = "value,user,normal"},
                                  {.low = 56, .high = INFINITY, .shell = true, .attributes = "normal"},
                                  {.low = DBL_MIN, .high = 99, .labels = true, .attributes = "label"},
                                  {.low = 1e6, .high = 1e7}};
  for (size_t i = 0; i < G_N_ELEMENTS(cases) * G_N_ELEMENTS(volumes); i++) {
    const tc_volume *v = volumes[i % G_N_ELEMENTS(volumes)];
    const tc_vmd_options *options = &cases[i / G_N_ELEMENTS(volumes)];
    tc_vmd *m = tc_vmd_of_volume(v, options, pool, NULL), *alone = tc_vmd_of_volume(v, options, NULL, NULL);
    expect_same(m, alone);
    for (int packed = 0; packed < 2; packed++) {
      g_autoptr(GByteArray) file = tc_vmd_encode(m, packed, NULL);
      g_autoptr(tc_vmd) back = tc_vmd_decode(file->data, file->len, NULL);
      assert_non_null(back);
      expect_same(m, back);
    }
    tc_vmd_free(m);
    tc_vmd_free(alone);
  }
  tc_pool_free(pool);
  for (size_t i = 0; i < G_N_ELEMENTS(volumes); i++)
    tc_volume_unref(volumes[i]);
}

static int label_noise(int x, int y, int z) { return noise(z, x, y) % 300 - 1; }

static int user_noise(int x, int y, int z) { return noise(y, z, x); }

/* Twice as coarse, shifted and turned: axis x of this grid is y of the other. */
static const tc_volume_desc coarse = {.dims = {8, 16, 60},
                                      .type = TC_I16,
                                      .spacing = {2, 2, 2},
                                      .origin = {1.25, -0.75, 3},
                                      .slope = 2,
                                      .intercept = 1,
                                      .direction = {0, 1, 0, 1, 0, 0, 0, 0, 1}};

/* Label at a place (mm) of the coarse grid: 2 voxel + 1 of the nearest voxel; 0 outside, and where it is negative. */
static int label_at(double x, double y, double z) {
  const double at[3] = {(y + 0.75) / 2, (x - 1.25) / 2, (z - 3) / 2};
  int nearest[3];
  for (int k = 0; k < 3; k++) {
    nearest[k] = (int)floor(at[k] + 0.5);
    if (nearest[k] < 0 || nearest[k] >= coarse.dims[k]) return 0;
  }
  return MAX(2 * label_noise(nearest[0], nearest[1], nearest[2]) + 1, 0);
}

static void expect_number(const tc_vmd *m, const char *name, const uint8_t *record, double wanted) {
  const tc_vmd_attribute *a = tc_vmd_attribute_named(&m->head, name);
  if (tc_vmd_number(a, record) != wanted) fail_msg("%s: %g instead of %g", name, tc_vmd_number(a, record), wanted);
}

/* All four stand in one model, in any order, and survive a file; each normal is that of a model of normals alone. */
TEST(value_label_normal_and_user_stand_in_one_model) {
  tc_volume_desc same = noisy;
  same.slope = 1, same.intercept = 0;
  g_autoptr(tc_volume) v = volume_of(&noisy, noise);
  g_autoptr(tc_volume) labels = volume_of(&coarse, label_noise);
  g_autoptr(tc_volume) user = volume_of(&same, user_noise);
  tc_vmd_options options = {.low = 56, .high = 200, .attributes = "normal"};
  g_autoptr(tc_vmd) normals = tc_vmd_of_volume(v, &options, NULL, NULL);
  options.attributes = "user,value, normal ,label", options.label_of = labels, options.user_of = user;
  g_autoptr(tc_pool) pool = tc_pool_new(3, NULL);
  g_autoptr(tc_vmd) m = tc_vmd_of_volume(v, &options, pool, NULL);
  g_autoptr(GByteArray) file = tc_vmd_encode(m, true, NULL);
  g_autoptr(tc_vmd) back = tc_vmd_decode(file->data, file->len, NULL);
  expect_same(m, back);
  assert_int_equal(m->head.record_bytes, 1 + 1 + 2 + 2);
  int most = 0, without = 0;
  for (int i = 0; i < 37 * 21 * 130; i++) {
    const int x = i % 37, y = i / 37 % 21, z = i / 37 / 21, label = label_at(x, y, z);
    const uint8_t *record = tc_vmd_voxel(back, x, y, z), *normal = tc_vmd_voxel(normals, x, y, z);
    assert_true((record != NULL) == (normal != NULL));
    if (!record) continue;
    expect_number(back, "value", record, noise(x, y, z));
    expect_number(back, "label", record, label);
    expect_number(back, "user", record, user_noise(x, y, z));
    assert_memory_equal(record + 2, normal, 2);
    most = MAX(most, label), without += label == 0;
  }
  print_message("labels up to %d, %d of %d voxels without\n", most, without, (int)m->voxels);
  assert_true(most > 255 && without > 0);
}

/* A label map's voxels, with the values of another volume, whose scale the model has. */
TEST(labels_have_the_values_of_another_volume) {
  g_autoptr(tc_volume) v = volume_of(&grid, few);
  g_autoptr(tc_volume) labels = volume_of(&noisy, noise);
  tc_volume_desc near_grid = grid;
  memcpy(near_grid.origin, (double[3]){0}, sizeof near_grid.origin);
  g_autoptr(tc_volume) near = volume_of(&near_grid, few);
  const tc_vmd_options options = {.low = DBL_MIN, .high = INFINITY, .labels = true, .attributes = "value,label", .value_of = near};
  g_autoptr(tc_vmd) m = tc_vmd_of_volume(labels, &options, NULL, NULL);
  assert_float_equal(m->head.grid.slope, 2, 0);
  assert_string_equal(m->head.grid.unit, "HU");
  const uint8_t *record = tc_vmd_voxel(m, 1, 0, 34); /* 1, 0, 68 of the values */
  expect_number(m, "value", record, 768);
  expect_number(m, "label", record, noise(1, 0, 34));
  expect_number(m, "value", tc_vmd_voxel(m, 30, 10, 5), 0); /* outside: the least */
  g_autoptr(GError) error = NULL;
  tc_vmd_options wrong = options;
  wrong.value_of = v; /* at x = -10 .. -8 */
  assert_null(tc_vmd_of_volume(labels, &wrong, NULL, &error));
  assert_non_null(strstr(error->message, "labels: it lies outside"));
}

TEST(numbers_that_an_attribute_cannot_hold_are_refused) {
  tc_volume_desc high = noisy, far = noisy, fractions = noisy;
  high.slope = 1, high.intercept = 200, far.origin[1] = 500, fractions.slope = 0.5;
  g_autoptr(tc_volume) v = volume_of(&noisy, noise);
  const struct { const tc_volume_desc *desc; const char *user, *labels; } cases[] = {
      {&high, "user: whole numbers from 0 to 255 expected, the volume holds 2", NULL},
      {&far, "user: it lies outside", "labels: it lies outside"},
      {&fractions, "user: whole numbers", "labels: whole numbers"},
      {&coarse, "user: whole numbers from 0 to 255 expected, the volume holds -1 to", NULL}};
  for (size_t i = 0; i < 2 * G_N_ELEMENTS(cases); i++) {
    g_autoptr(GError) error = NULL;
    g_autoptr(tc_volume) other = volume_of(cases[i / 2].desc, cases[i / 2].desc == &coarse ? label_noise : noise);
    tc_vmd_options options = {.low = 0, .high = 255, .attributes = i % 2 ? "label" : "user"};
    *(i % 2 ? &options.label_of : &options.user_of) = other;
    g_autoptr(tc_vmd) m = tc_vmd_of_volume(v, &options, NULL, &error);
    const char *wanted = i % 2 ? cases[i / 2].labels : cases[i / 2].user;
    if ((m == NULL) != (wanted != NULL)) fail_msg("%zu: %s", i, m ? "made" : error->message);
    if (wanted) print_message("%s\n", error->message);
    if (wanted) assert_non_null(strstr(error->message, wanted));
  }
}

static bool in_range(int x, int y, int z) {
  bool inside = x >= 0 && y >= 0 && z >= 0 && x < 37 && y < 21 && z < 130;
  return inside && 255 - noise(x, y, z) >= 80;
}

/* What a range leaves of a model is the model of the volume in that range. */
TEST(parts_of_models_are_models_of_the_volume) {
  g_autoptr(tc_pool) pool = tc_pool_new(3, NULL);
  g_autoptr(tc_volume) v = volume_of(&noisy, stretches);
  tc_vmd *all = tc_vmd_of_volume(v, &(tc_vmd_options){.low = 0, .high = INFINITY, .attributes = "value,user"}, NULL, NULL);
  g_autoptr(tc_volume) sparse = tc_vmd_volume(all, NULL);
  const double ranges[][2] = {{0, 255}, {100, 200}, {240.5, 300}, {255, 255}, {1e6, 1e7}};
  for (size_t i = 0; i < G_N_ELEMENTS(ranges); i++) {
    const tc_vmd_options options = {.low = ranges[i][0], .high = ranges[i][1]};
    g_autoptr(tc_vmd) part = tc_vmd_of_volume(sparse, &options, pool, NULL);
    g_autoptr(tc_vmd) whole = tc_vmd_of_volume(v, &options, pool, NULL);
    print_message("%g to %g: %llu voxels\n", options.low, options.high, (unsigned long long)whole->voxels);
    expect_same(part, whole);
  }
  g_autoptr(GError) error = NULL;
  assert_null(tc_vmd_of_volume(sparse, &(tc_vmd_options){.low = 0, .high = 9, .attributes = "value"}, NULL, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_INVALID));
}

TEST(a_shell_leaves_out_what_has_six_filled_neighbours) {
  g_autoptr(tc_volume) v = volume_of(&noisy, noise);
  g_autoptr(tc_vmd) m = tc_vmd_of_volume(v, &(tc_vmd_options){.low = 80, .high = INFINITY, .shell = true}, NULL, NULL);
  for (int z = 0; z < 130; z++)
    for (int y = 0; y < 21; y++)
      for (int x = 0; x < 37; x++) {
        bool hidden = in_range(x - 1, y, z) && in_range(x + 1, y, z) && in_range(x, y - 1, z) &&
                      in_range(x, y + 1, z) && in_range(x, y, z - 1) && in_range(x, y, z + 1);
        assert_true((tc_vmd_voxel(m, x, y, z) != NULL) == (in_range(x, y, z) && !hidden));
      }
}

/* A ball in a stretched grid: normals point outwards, to a degree or two. */
static int ball(int x, int y, int z) {
  double r = sqrt((x - 12) * (x - 12) + (y - 12) * (y - 12) * 4.0 + (z - 12) * (z - 12));
  return (int)lround(fmin(fmax(100 + 20 * (9 - r), 0), 255));
}

static int mask_of_ball(int x, int y, int z) { return ball(x, y, z) >= 100; }

/* The largest and the mean angle between the normals of a ball's shell and its radii, degrees. */
static double angle_of_normals(int (*value)(int x, int y, int z), tc_vmd_options options, double *mean) {
  const tc_volume_desc desc = {
      .dims = {25, 25, 25}, .type = TC_U8, .spacing = {1, 2, 1}, .slope = 1, .direction = {0, 1, 0, -1, 0, 0, 0, 0, 1}};
  g_autoptr(tc_volume) v = volume_of(&desc, value);
  options.high = 4000, options.shell = true, options.attributes = "normal";
  tc_vmd *m = tc_vmd_of_volume(v, &options, NULL, NULL);
  double worst = 0, sum = 0;
  int count = 0;
  for (int i = 0; i < 25 * 25 * 25; i++) {
    const int x = i % 25, y = i / 25 % 25, z = i / 625;
    const uint8_t *record = tc_vmd_voxel(m, x, y, z);
    if (!record || hypot(hypot(x - 12, 2 * (y - 12)), z - 12) < 8) continue;
    float n[3];
    tc_octahedron_unfold(record[0], record[1], 127, n);
    const double out[3] = {2 * (y - 12), -(x - 12), z - 12}, length = hypot(hypot(out[0], out[1]), out[2]);
    const double cosine = ((double)n[0] * out[0] + (double)n[1] * out[1] + (double)n[2] * out[2]) / length;
    worst = fmax(worst, acos(fmin(cosine, 1)) * 180 / M_PI);
    sum += acos(fmin(cosine, 1)) * 180 / M_PI, count++;
  }
  tc_vmd_free(m);
  *mean = sum / count;
  return worst;
}

/* Of values, half a voxel, 1 mm of 9, further out than the voxel; of labels and of masks, from the voxels around, without
 * the steps of those. */
TEST(normals_point_out_of_the_object) {
  double mean, worst = angle_of_normals(ball, (tc_vmd_options){.low = 100}, &mean);
  print_message("furthest from the radius: %.2f degrees\n", worst);
  assert_true(worst < 8);
  for (int labels = 0; labels < 2; labels++) {
    worst = angle_of_normals(mask_of_ball, (tc_vmd_options){.low = 1, .labels = labels}, &mean);
    print_message("furthest: %.2f degrees, on average %.2f, of a %s\n", worst, mean, labels ? "label" : "mask");
    assert_true(worst < 20 && mean < 8);
  }
}

/* ---- files that are wrong ---- */

static void expect_refused(GByteArray *file, size_t size, const char *what) {
  g_autoptr(GError) error = NULL;
  uint8_t *exact = g_memdup2(file->data, size); /* an over-read is seen */
  tc_vmd *m = tc_vmd_decode(exact, size, &error);
  if (m) fail_msg("read in spite of %s", what);
  assert_int_equal(error->code, TC_ERROR_FORMAT);
  assert_null(strpbrk(error->message, "\r\n"));
  g_free(exact);
}

TEST(every_prefix_is_refused) {
  for (int packed = 0; packed < 2; packed++) {
    g_autoptr(tc_vmd) m = few_model("value,normal");
    g_autoptr(GByteArray) file = tc_vmd_encode(m, packed, NULL);
    for (size_t size = 0; size < file->len; size++)
      expect_refused(file, size, "its end missing");
  }
}

/* One byte another, with a right checksum: refused, or as sound a model as any. */
TEST(any_changed_byte_is_survived) {
  g_autoptr(tc_vmd) m = few_model("value");
  g_autoptr(GByteArray) file = tc_vmd_encode(m, false, NULL);
  int refused = 0;
  for (size_t at = 0; at < file->len - 4; at++)
    for (int change = 1; change < 256; change += at < 260 ? 50 : 1) {
      file->data[at] ^= (uint8_t)change;
      sign(file);
      tc_vmd *back = tc_vmd_decode(file->data, file->len, NULL);
      if (back) assert_true(back->voxels <= 3 * 2 * 70 * 256);
      refused += !back;
      tc_vmd_free(back);
      file->data[at] ^= (uint8_t)change;
    }
  print_message("%d changes refused\n", refused);
  assert_true(refused > 2500);
  sign(file);
  file->data[file->len - 1] ^= 1;
  expect_refused(file, file->len, "a wrong checksum");
}

TEST(wrong_runs_and_counts_are_refused) {
  static const struct {
    size_t at;
    uint8_t value;
    const char *what;
  } wrong[] = {{4, 3, "version 3"},
               {6, 4, "an unknown flag"},
               {11, 0x7f, "a wild size"},
               {17, 0x80, "an axis of more than 32768 voxels"},
               {8, 0, "no columns at all"},
               {36, 3, "one column more"},
               {40, 8, "one voxel more"},
               {47, 0xff, "wild voxels"},
               {55, 0xff, "a wild body"},
               {232, 9, "nine attributes"},
               {234, 3, "a record of another size"},
               {260, 18, "a longer column"},
               {271, 63, "a run beyond the grid"},
               {270, 9 << 2, "a run beyond the column"},
               {270, 4 << 2 | 3, "an unknown kind of run"},
               {280, 4, "no end"},
               {280, 1, "an empty run that is the same"},
               {281, 0, "an empty run in front"}};
  for (size_t i = 0; i < G_N_ELEMENTS(wrong); i++) {
    g_autoptr(tc_vmd) m = few_model("value");
    g_autoptr(GByteArray) file = tc_vmd_encode(m, false, NULL);
    file->data[wrong[i].at] = wrong[i].value;
    sign(file);
    expect_refused(file, file->len, wrong[i].what);
  }
}

/* The last columns of the largest grid, of 32 TiB: a volume, and splats, of what is filled. */
TEST(grids_may_be_larger_than_memory) {
  const uint32_t dims[3] = {TC_VMD_SIDE, TC_VMD_SIDE, TC_VMD_SIDE}, first[2] = {TC_VMD_SIDE - 2, TC_VMD_SIDE - 2};
  g_autoptr(tc_vmd) m = few_model("value");
  g_autoptr(GByteArray) file = tc_vmd_encode(m, false, NULL);
  memcpy(file->data + 8, dims, sizeof dims);
  memcpy(file->data + 20, first, sizeof first);
  sign(file);
  tc_vmd *large = tc_vmd_decode(file->data, file->len, NULL);
  assert_non_null(large);
  g_autoptr(tc_volume) v = tc_vmd_volume(large, NULL);
  assert_non_null(v);
  double value;
  assert_true(tc_volume_voxel(v, (int[]){TC_VMD_SIDE - 1, TC_VMD_SIDE - 1, 0}, &value) && value == 900);
  tc_splats *s = tc_splats_build(large, (tc_splat_normals){0}, false, NULL, NULL);
  assert_int_equal(s->n, 7);
  assert_int_equal(s->n_bricks, 2);
  tc_splat_brick brick = {0};
  size_t from = 0;
  for (int i = 0; i < 2; i++) {
    tc_splats_next(s, &from, &brick);
    for (int k = 0; k < 3; k++) assert_int_equal(brick.at[k], k < 2 ? TC_VMD_SIDE / TC_SPLAT_BRICK - 1 : 4 * i);
  }
  /* Cut open between x = -2 and -1, from the end. */
  const double plane[1][4] = {{-1, 0, 0, TC_VMD_SIDE - 1.5}};
  tc_splats *cut = tc_splats_cut(large, s, plane, 1, NULL, NULL);
  assert_int_equal(cut->n, 6);
  tc_splats_free(cut);
  tc_splats_free(s);
}

TEST(attributes_that_are_not_there_are_refused) {
  g_autoptr(tc_volume) v = volume_of(&noisy, noise);
  static const char *const wrong[] = {"label", "value,value", "density", "value,,normal"};
  for (size_t i = 0; i < G_N_ELEMENTS(wrong); i++) {
    g_autoptr(GError) error = NULL;
    assert_null(tc_vmd_of_volume(v, &(tc_vmd_options){.low = 0, .high = 9, .attributes = wrong[i]}, NULL, &error));
    print_message("%s: %s\n", wrong[i], error->message);
  }
}

TESTS(NULL, NULL)
