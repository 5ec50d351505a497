/* What the DICOM helper program must refuse, its limits, its progress and its confinement. */
#include "tests/support/dicom_series.h"
#include <sys/stat.h>
#include <unistd.h>

#include "renderer/import/wire.h"
#include "tests/support/confined.h"

TEST(hostile_headers) {
  int16_t pixels[PIXELS];
  static const char *const frames[] = {"2", "2147483647", "99999999999999999999", "-5x", "1A"};
  fill(pixels, 0);
  for (size_t i = 0; i < G_N_ELEMENTS(frames) + 3; i++) {
    dicom_spec s;
    init(&s, pixels);
    if (i < G_N_ELEMENTS(frames))
      s.frames = frames[i];
    else if (i == G_N_ELEMENTS(frames))
      s.rows = s.columns = 65535;
    else if (i == G_N_ELEMENTS(frames) + 1)
      s.allocated = s.stored = 24;
    else
      s.pixels = NULL;
    char *folder, *path = one_file(&folder, &s);
    int code = refused(path, NULL);
    assert_true(code == TC_ERROR_FORMAT || code == TC_ERROR_UNSUPPORTED);
    drop(folder, path);
  }
}

/* An element that announces 4 GB: GDCM would allocate it first. */
TEST(a_huge_element) {
  GByteArray *b = dicom_start();
  char *folder = temp_folder(), *path = g_build_filename(folder, "one", NULL);
  dicom_u16(b, 0x08);
  dicom_u16(b, 0x05);
  g_byte_array_append(b, (const uint8_t *)"OB\0\0\xfe\xff\xff\xff", 8);
  g_file_set_contents(path, (const char *)b->data, b->len, NULL);
  assert_int_equal(refused(path, NULL), TC_ERROR_FORMAT);
  g_byte_array_free(b, TRUE);
  drop(folder, path);
}

/* By the helper program; the decoder alone is given every prefix by fuzz_gdcm. */
TEST(prefixes_are_refused) {
  int16_t pixels[PIXELS];
  dicom_spec s;
  init(&s, pixels);
  fill(pixels, 0);
  GByteArray *b = dicom_bytes(&s);
  char *folder = temp_folder(), *path = g_build_filename(folder, "one", NULL);
  for (guint n = 0; n < b->len; n += 67) {
    g_file_set_contents(path, (const char *)b->data, n, NULL);
    refused(path, NULL);
  }
  g_byte_array_free(b, TRUE);
  drop(folder, path);
}

TEST(not_there_and_not_ours) {
  char *folder = temp_folder(), *path = g_build_filename(folder, "none", NULL);
  assert_int_equal(refused(path, NULL), TC_ERROR_NOT_FOUND);
  assert_int_equal(refused(folder, NULL), TC_ERROR_FORMAT);
  assert_true(tc_helper_for(path) == TC_HELPER_FORMATS);
  assert_true(tc_helper_for(folder) == TC_HELPER_FORMATS);
  assert_int_equal(mkfifo(path, 0600), 0); /* must neither hang nor be read */
  assert_int_equal(refused(path, NULL), TC_ERROR_FORMAT);
  assert_true(tc_helper_for(path) == TC_HELPER_FORMATS);
  drop(folder, path);
}

TEST(limits_and_helpers) {
  g_autofree char *folder = temp_folder();
  GError *error = NULL;
  write_series(folder, "1.2.3.1", 1, SLICES);
  tc_import_options options = {.helpers = TC_BINARY_DIR, .max_voxel_bytes = PIXELS * SLICES * 2 - 1};
  assert_null(tc_helper_load(TC_HELPER_DICOM, folder, NULL, &options, &error));
  assert_int_equal(error->code, TC_ERROR_LIMIT);
  g_clear_error(&error);
  options.max_voxel_bytes++;
  tc_volume *v = tc_helper_load(TC_HELPER_DICOM, folder, NULL, &options, &error);
  assert_non_null(v);
  tc_volume_unref(v);
  static const char *const bad_helpers[] = {"/nonexistent", "/bin/true", "/bin/echo"};
  char *others = temp_folder(), *other = g_build_filename(others, "tomocast-dicom", NULL);
  options.helpers = others;
  for (int i = 0; i < 3; i++) {
    assert_int_equal(symlink(bad_helpers[i], other), 0);
    assert_null(tc_helper_load(TC_HELPER_DICOM, folder, NULL, &options, &error));
    assert_non_null(error);
    g_clear_error(&error);
    g_unlink(other);
  }
  drop(others, other);
  v = tc_helper_load(TC_HELPER_DICOM, folder, NULL, NULL, &error); /* beside this program */
  assert_non_null(v);
  tc_volume_unref(v);
  remove_tree(folder);
}

typedef struct watcher {
  int calls, stop_after;
  double last;
} watcher;

static bool watch(void *user, double fraction) {
  watcher *w = user;
  assert_true(fraction >= w->last && fraction <= 1);
  w->last = fraction;
  return ++w->calls != w->stop_after;
}

TEST(progress_and_cancel) {
  g_autofree char *folder = temp_folder();
  GError *error = NULL;
  write_series(folder, "1.2.3.1", 1, SLICES);
  watcher w = {.stop_after = -1};
  tc_import_options options = {.helpers = TC_BINARY_DIR, .progress = watch, .user = &w};
  tc_volume *v = tc_helper_load(TC_HELPER_DICOM, folder, NULL, &options, &error);
  assert_non_null(v);
  tc_volume_unref(v);
  assert_true(w.calls >= 2 * SLICES && w.last == 1);
  for (int stop = 1; stop <= 2 * SLICES; stop += 4) { /* calls beyond these come with time only */
    watcher quitter = {.stop_after = stop};
    options.user = &quitter;
    assert_null(tc_helper_load(TC_HELPER_DICOM, folder, NULL, &options, &error));
    assert_int_equal(error->code, TC_ERROR_CANCELLED);
    g_clear_error(&error);
  }
  remove_tree(folder);
}

static bool for_a_while(void *user, double fraction) { return ++*(int *)user < 20; }

/* A decoder that was taken over asks for files without end and reads no answer: the load is cancelled all the same. */
TEST(a_helper_that_never_reads_holds_up_nothing) {
  char *folder = temp_folder(), *helpers = temp_folder(), *helper = g_build_filename(helpers, "tomocast-import", NULL);
  char *file = g_build_filename(folder, "f.nrrd", NULL);
  char *script = g_strdup_printf("#!/usr/bin/perl\nopen(my $s, '>&=', %d) or die;\nmy $m = pack('VVV', %u, %d, 1) . pack('a%d', 'x');\n"
                                 "1 while syswrite($s, $m);\n",
                                 TC_HELPER_SOCKET_FD, (unsigned)TC_WIRE_OPEN, 4 + TC_WIRE_NAME, TC_WIRE_NAME);
  assert_true(g_file_set_contents(helper, script, -1, NULL) && chmod(helper, 0700) == 0);
  assert_true(g_file_set_contents(file, "NRRD0004\n", -1, NULL));
  int calls = 0;
  GError *error = NULL;
  const tc_import_options options = {.helpers = helpers, .progress = for_a_while, .user = &calls};
  alarm(60); /* it would wait for ever */
  assert_null(tc_helper_load(TC_HELPER_FORMATS, file, NULL, &options, &error));
  alarm(0);
  assert_int_equal(error->code, TC_ERROR_CANCELLED);
  g_error_free(error);
  g_free(script);
  drop(helpers, helper);
  drop(folder, file);
}

TEST(the_helpers_are_confined) {
  enum { SIDE = 1200 }; /* more than the ring holds */
  int16_t *pixels = g_new0(int16_t, SIDE * SIDE);
  char *folder, *path, text[] = "NRRD0004\ntype: short\ndimension: 3\nsizes: 1200 1200 1\nencoding: raw\nendian: little\n\n";
  dicom_spec s;
  dicom_spec_init(&s, SIDE, SIDE, pixels, SIDE * SIDE * sizeof *pixels);
  path = one_file(&folder, &s);
  is_confined("tomocast-dicom", path);
  GByteArray *nrrd = g_byte_array_new();
  g_byte_array_append(nrrd, (const guint8 *)text, sizeof text - 1);
  g_byte_array_append(nrrd, (const guint8 *)pixels, SIDE * SIDE * sizeof *pixels);
  assert_true(g_file_set_contents(path, (const char *)nrrd->data, nrrd->len, NULL));
  is_confined("tomocast-import", path);
  g_byte_array_free(nrrd, TRUE);
  g_free(pixels);
  drop(folder, path);
}

TESTS(NULL, NULL)
