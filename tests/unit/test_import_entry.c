/* The one entry: what is refused at the door, cancelling, limits, memory; and the reader below it. */
#define TC_TEST_BY_HELPER(name, options) (!(options) || !(options)->progress) /* from a helper calls come with time as well */
#include "import_files.h"

#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>

#include "renderer/import/helper/names.h"
#include "renderer/import/reader.h"

#define HEADER "NRRD0004\ntype: int\ndimension: 3\nsizes: 64 64 64\nencoding: raw\nendian: little\n\n"
enum { voxels = 64 * 64 * 64 };

static void write_ints(const char *name) {
  g_autoptr(GByteArray) data = g_byte_array_new();
  for (int i = 0; i < voxels; i++) put_uint(data, (uint64_t)i % 200, 4, false);
  g_autoptr(GByteArray) file = with_header(HEADER, data);
  write_bytes(name, file);
}

TEST(what_is_no_volume) {
  g_autofree char *fifo = path_of("fifo.nii");
  open_bad("gone.nii", TC_ERROR_NOT_FOUND, "open gone.nii: no such file");
  open_bad("gone.nii#2", TC_ERROR_NOT_FOUND, "no such file");
  write_file("empty.nii", NULL, 0);
  open_bad("empty.nii", TC_ERROR_FORMAT, "empty");
  write_text("story.txt", "It was a dark and stormy night.");
  open_bad("story.txt", TC_ERROR_FORMAT, "unknown kind of file");
  write_text("two\nlines", "It was a dark and stormy night.");
  open_bad("two\nlines", TC_ERROR_FORMAT, "open two?lines: unknown kind of file");
  write_text("story.nii", "It was a dark and stormy night.");
  open_bad("story.nii", TC_ERROR_FORMAT, "no NIfTI header");
  GByteArray *zip = deflated("It was", 6, true);
  write_bytes("story.gz", zip);
  open_bad("story.gz", TC_ERROR_FORMAT, "unknown kind of file");
  g_byte_array_unref(zip);
  assert_int_equal(mkfifo(fifo, 0600), 0);
  open_bad("fifo.nii", TC_ERROR_FORMAT, "not a regular file"); /* and does not wait for a writer */
}

TEST(a_number_sign_in_a_name) {
  write_ints("scan#2");
  tc_volume_unref(open_good("scan#2"));
  write_ints("scan.nrrd");
  open_bad("scan.nrrd#1", TC_ERROR_INVALID, "NRRD holds no series");
}

TEST(demos) {
  g_autoptr(GError) error = NULL;
  tc_volume *v = tc_import("demo:marschner-lobb", NULL, &error);
  assert_non_null(v);
  assert_string_equal(tc_volume_describe(v)->format, "demo");
  tc_volume_unref(v);
  assert_null(tc_import("demo:nothing", NULL, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_NOT_FOUND));
}

TEST(lists_only_dicom) {
  tc_series *series = (tc_series *)1;
  size_t count = 7;
  g_autofree char *path = path_of("list.nrrd");
  write_ints("list.nrrd");
  assert_true(tc_import_list(path, NULL, &series, &count, NULL));
  assert_int_equal(count, 0);
  assert_null(series);
  assert_true(tc_import_list("demo:head", NULL, &series, &count, NULL));
  g_unlink(path);
  g_autoptr(GError) error = NULL;
  assert_false(tc_import_list(path, NULL, &series, &count, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_NOT_FOUND));
}

typedef struct watch { int calls, stop_after; double last; bool backwards; } watch;

static bool watching(void *user, double fraction) {
  watch *w = user;
  if (fraction < w->last || fraction > 1) w->backwards = true;
  w->last = fraction;
  return ++w->calls != w->stop_after;
}

TEST(progress_and_cancelling) {
  GError *error = NULL;
  watch w = {0};
  tc_import_options options = {.progress = watching, .user = &w};
  write_ints("slow.nrrd");
  tc_volume *v = open_with("slow.nrrd", &options, &error);
  assert_non_null(v);
  assert_int_equal(tc_volume_describe(v)->type, TC_U8);
  assert_true(w.calls > 4 && !w.backwards && w.last == 1); /* both passes count */
  tc_volume_unref(v);
  for (int stop = 1; stop <= w.calls; stop++) {
    watch again = {.stop_after = stop};
    options.user = &again;
    assert_null(open_with("slow.nrrd", &options, &error));
    assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_CANCELLED));
    assert_int_equal(again.calls, stop);
    g_clear_error(&error);
  }
}

TEST(the_limit_counts_stored_bytes) {
  g_autoptr(GError) error = NULL;
  tc_import_options options = {.max_voxel_bytes = voxels};
  write_ints("limit.nrrd"); /* four bytes each in the file, one in memory */
  tc_volume *v = open_with("limit.nrrd", &options, &error);
  assert_non_null(v);
  tc_volume_unref(v);
  options.max_voxel_bytes = voxels - 1;
  assert_null(open_with("limit.nrrd", &options, &error));
  assert_true(g_error_matches(error, TC_ERROR, TC_ERROR_LIMIT));
}

/* ---- memory ---- */

enum { big_x = 512, big_y = 512, big_z = 400 };

/* About 200 MB of voxels that compress like a scan's: a ramp with noise in the low bits. */
static void write_big(const char *path) {
  uint8_t header[352] = {0};
  GByteArray view = {header, sizeof header};
  put_at(&view, 0, 348, 4, false);
  memcpy(header + 344, "n+1", 4);
  const int dim[8] = {3, big_x, big_y, big_z, 1, 1, 1, 1};
  for (int i = 0; i < 8; i++) put_at(&view, 40 + 2 * (size_t)i, (uint64_t)dim[i], 2, false);
  put_at(&view, 70, 512, 2, false);
  for (int i = 0; i < 4; i++) put_f32_at(&view, 76 + 4 * (size_t)i, 1, false);
  put_f32_at(&view, 108, 352, false);
  gzFile file = gzopen(path, "wb1");
  assert_non_null(file);
  assert_int_equal(gzwrite(file, header, sizeof header), sizeof header);
  uint16_t *row = g_new(uint16_t, big_x * big_y);
  uint32_t noise = 1;
  for (int z = 0; z < big_z; z++) {
    for (int i = 0; i < big_x * big_y; i++) {
      noise = noise * 1664525u + 1013904223u;
      row[i] = (uint16_t)(z * 8 + (i & 511) + (noise >> 30));
    }
    assert_int_equal(gzwrite(file, row, big_x * big_y * 2), big_x * big_y * 2);
  }
  g_free(row);
  assert_int_equal(gzclose(file), Z_OK);
}

TEST(memory_stays_near_the_voxels) {
  needs(!SANITIZED); /* which has memory of its own */
  g_autofree char *path = path_of("big.nii.gz");
  write_big(path);
  pid_t child = fork();
  assert_true(child >= 0);
  if (child == 0) {
    tc_volume *v = tc_import(path, NULL, NULL);
    double some = v ? voxel(v, big_x * big_y * 7 + 5) - (7 * 8 + 5) : -1; /* what is left is the noise */
    _exit(some >= 0 && some < 4 ? 0 : 1);
  }
  int status;
  struct rusage usage;
  assert_int_equal(wait4(child, &status, 0, &usage), child);
  assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  double voxel_bytes = 2.0 * big_x * big_y * big_z, peak = 1024.0 * (double)usage.ru_maxrss;
  print_message("peak %.0f MiB for %.0f MiB of voxels\n", peak / 1048576, voxel_bytes / 1048576);
  assert_true(peak >= voxel_bytes && peak <= 1.3 * voxel_bytes + 64 * 1048576.0);
}

/* ---- below ---- */

TEST(the_reader_never_passes_its_end) {
  const uint8_t bytes[9] = {1, 2, 3, 4, 5, 6, 7, 8, 9};
  for (int big = 0; big < 2; big++) {
    tc_reader r;
    tc_reader_init(&r, bytes, sizeof bytes, big);
    assert_int_equal(tc_reader_u16(&r), big ? 0x0102 : 0x0201);
    assert_int_equal(tc_reader_u32(&r), big ? 0x03040506 : 0x06050403);
    assert_int_equal(tc_reader_left(&r), 3);
    assert_false(r.failed);
    assert_int_equal(tc_reader_u32(&r), 0);
    assert_true(r.failed);
    assert_int_equal(tc_reader_left(&r), 3);
    tc_reader_init(&r, bytes, sizeof bytes, big);
    assert_true(tc_reader_u64(&r) == (big ? 0x0102030405060708u : 0x0807060504030201u));
    tc_reader_seek(&r, 9);
    assert_false(r.failed);
    assert_int_equal(tc_reader_u8(&r), 0);
    assert_true(r.failed);
    tc_reader_init(&r, bytes, sizeof bytes, big);
    tc_reader_seek(&r, 10);
    assert_true(r.failed && r.at == 0);
  }
}

TEST(lines_and_numbers) {
  tc_reader r;
  tc_reader_init(&r, "a\r\n\nlong line\nend", 17, false);
  const char *const wanted[] = {"a", "", "long line", "end"};
  for (int i = 0; i < 4; i++) {
    g_autofree char *line = tc_reader_line(&r, 9);
    assert_string_equal(line, wanted[i]);
  }
  assert_null(tc_reader_line(&r, 9));
  assert_false(r.failed);
  tc_reader_init(&r, "0123456789", 10, false);
  assert_null(tc_reader_line(&r, 9));
  assert_true(r.failed);
  double v[3];
  assert_int_equal(tc_text_numbers(" 1 -2.5e3\t.5 ", v, 3), 3);
  assert_true(v[0] == 1 && v[1] == -2500 && v[2] == 0.5);
  assert_int_equal(tc_text_numbers("1 2 3 4", v, 3), 4);
  assert_int_equal(tc_text_numbers("1 2x", v, 3), -1);
  assert_int_equal(tc_text_numbers("", v, 3), 0);
  int64_t n;
  assert_true(tc_text_integer(" 12 ", 0, 12, &n) && n == 12);
  assert_false(tc_text_integer("13", 0, 12, &n) || tc_text_integer("1.5", 0, 12, &n) || tc_text_integer("", 0, 12, &n));
  g_autofree char *quoted = tc_text_quote("a\x1b[2Jb");
  assert_string_equal(quoted, "'a?[2Jb'");
}

TEST(name_patterns) {
  g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
  int64_t rest;
  assert_true(tc_names_from_pattern("a%%b%03d.c%%d 8 12 2 3", names, &rest, NULL));
  assert_int_equal(names->len, 3);
  assert_string_equal(names->pdata[0], "a%b008.c%d");
  assert_string_equal(names->pdata[2], "a%b012.c%d");
  assert_int_equal(rest, 3);
  static const char *const bad[] = {"a%s 1 2 1",    "a%d%d 1 2 1", "a%d 1 2",    "a%d 1 2 0", "a%d 2 1 1",
                                    "a%999d 1 2 1", "a%n 1 2 1",   "a% 1 2 1",   "a 1 2 1",   "%d",
                                    "a%d 1 1e99 1", "a%d -1 2 1",  "a%d 1 2.5 1"};
  for (size_t i = 0; i < G_N_ELEMENTS(bad); i++) {
    g_autoptr(GError) error = NULL;
    if (tc_names_from_pattern(bad[i], names, NULL, &error)) print_error("%s passed\n", bad[i]);
    assert_non_null(error);
  }
}

/* A helper asks for the files that a header names; what is no regular file beside it is refused here. */
TEST(files_beside_a_header) {
  uint8_t half[32];
  memset(half, 7, sizeof half);
  write_file("one.raw", half, sizeof half);
  memset(half, 9, sizeof half);
  write_file("two.raw", half, sizeof half);
  write_text("pair.nhdr", "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: LIST 3\none.raw\ntwo.raw\n");
  tc_volume *v = open_good("pair.nhdr");
  assert_true(voxel(v, 0) == 7 && voxel(v, 31) == 7 && voxel(v, 32) == 9 && voxel(v, 63) == 9);
  tc_volume_unref(v);
  write_text("one.mhd", "NDims = 3\nDimSize = 4 4 2\nElementType = MET_UCHAR\nElementDataFile = one.raw\n");
  v = open_good("one.mhd");
  assert_true(voxel(v, 31) == 7);
  tc_volume_unref(v);
  write_text("out.mhd", "NDims = 3\nDimSize = 4 4 2\nElementType = MET_UCHAR\nElementDataFile = ../one.raw\n");
  open_bad("out.mhd", TC_ERROR_FORMAT, "beside its header");
  write_text("none.mhd", "NDims = 3\nDimSize = 4 4 2\nElementType = MET_UCHAR\nElementDataFile = none.raw\n");
  open_bad("none.mhd", TC_ERROR_FORMAT, "none.raw': missing, put it beside the header");
}

/* What decodes files is in the helpers and not in the daemon. */
TEST(the_daemon_has_no_decoder) {
  static const char *const programs[] = {"tomocast", "tomocast-import"};
  for (int i = 0; i < 2; i++) {
    char *path = g_build_filename(TC_BINARY_DIR, programs[i], NULL), *bytes;
    gsize size;
    assert_true(g_file_get_contents(path, &bytes, &size, NULL));
    assert_int_equal(memmem(bytes, size, "BZ2_bzDecompress", 16) != NULL, i == 1);
    assert_int_equal(memmem(bytes, size, "NIfTI header is cut short", 25) != NULL, i == 1);
    g_free(bytes);
    g_free(path);
  }
}

TESTS(make_folder, remove_folder)
