/* What an import may cost: it stops when it is told to, decodes no more than its header says, asks for memory before it
 * takes any, and reads no other file where it may not. */
#include "import_files.h"

#define SIZES_4 "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 4 4 4\n"

typedef struct listener {
  int asked, stop_at; /* progress: how often, and when to say no (0 = never) */
  int reserved;       /* how often */
  uint64_t bytes;     /* the last wish */
  uint64_t most;      /* what is granted */
} listener;

static bool on_progress(void *user, double fraction) {
  listener *l = user;
  assert_true(fraction >= 0 && fraction <= 1);
  return ++l->asked != l->stop_at;
}

static bool on_reserve(void *user, uint64_t bytes, GError **error) {
  listener *l = user;
  l->reserved++;
  l->bytes = bytes;
  if (bytes <= l->most) return true;
  tc_set_error(error, TC_ERROR_BUSY, NULL, "not now");
  return false;
}

static tc_volume *open_listening(const char *name, listener *l, GError **error) {
  if (!l->most) l->most = UINT64_MAX;
  const tc_import_options options = {.progress = on_progress, .reserve = on_reserve, .user = l};
  return open_with(name, &options, error);
}

/* `times` streams of 16 MiB of zeros each, of 50 bytes or so. */
static GByteArray *bomb(int times) {
  static uint8_t one[4096];
  static unsigned length;
  if (!length) {
    const unsigned size = 16u << 20;
    g_autofree uint8_t *zeros = g_malloc0(size);
    length = sizeof one;
    assert_int_equal(BZ2_bzBuffToBuffCompress((char *)one, &length, (char *)zeros, size, 9, 0, 0), BZ_OK);
  }
  GByteArray *all = g_byte_array_new();
  for (int i = 0; i < times; i++) g_byte_array_append(all, one, length);
  return all;
}

static void write_bomb(const char *name, const char *header, int times) {
  GByteArray *data = bomb(times), *file = with_header(header, data);
  assert_true(file->len < 20000);
  write_bytes(name, file);
  g_byte_array_unref(file);
  g_byte_array_unref(data);
}

static void expect(GError *error, int code, const char *text) {
  assert_non_null(error);
  if (error->code != code || !strstr(error->message, text)) fail_msg("[%d] %s", error->code, error->message);
  g_error_free(error);
}

TEST(bytes_before_the_voxels_are_bounded) {
  listener l = {0};
  GError *error = NULL;
  write_bomb("lead.nrrd", SIZES_4 "encoding: bzip2\nbyte skip: 1000000000\n\n", 80);
  assert_null(open_listening("lead.nrrd", &l, &error));
  expect(error, TC_ERROR_LIMIT, "256 MiB");
  assert_int_equal(l.asked, 0);
}

/* 1.3 GB are announced as later frames: about 64 MiB of them are looked at. */
TEST(frames_nobody_reads_are_hardly_decoded) {
  listener l = {0};
  GError *error = NULL;
  write_bomb("frames.nrrd", "NRRD0004\ntype: uchar\ndimension: 4\nsizes: 4 4 4 20000000\n"
             "space: LPS\nspace directions: (1,0,0) (0,1,0) (0,0,1) none\nencoding: bzip2\n\n", 80);
  g_autoptr(tc_volume) volume = open_listening("frames.nrrd", &l, &error);
  assert_non_null(volume);
  print_message("asked %d times\n", l.asked);
  assert_in_range(l.asked, 64, 2000);
  assert_int_equal(l.bytes, 64);
}

TEST(a_decoding_import_stops_when_told) {
  static const char *const headers[] = {
      "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 1000 1000 1000\nencoding: bzip2\n\n",
      "NRRD0004\ntype: int\nendian: little\ndimension: 3\nsizes: 600 600 600\nencoding: bzip2\n\n",
      "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 100 100 100\nencoding: bzip2\nbyte skip: -1\n\n",
      "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 100 100 100\nencoding: bzip2\nbyte skip: 200000000\n\n",
  };
  for (size_t i = 0; i < G_N_ELEMENTS(headers); i++) {
    listener l = {.stop_at = 5};
    GError *error = NULL;
    write_bomb("stop.nrrd", headers[i], 64);
    assert_null(open_listening("stop.nrrd", &l, &error));
    expect(error, TC_ERROR_CANCELLED, "cancelled");
    assert_int_equal(l.asked, 5);
  }
}

/* Members that hold nothing decode to nothing, for as long as there are bytes. */
TEST(empty_members_are_asked_about) {
  GByteArray *empty = deflated("", 0, true), *all = g_byte_array_new();
  while (all->len < 4 << 20) g_byte_array_append(all, empty->data, empty->len);
  g_autoptr(GByteArray) file = with_header(SIZES_4 "encoding: gzip\n\n", all);
  write_bytes("empty.nrrd", file);
  write_bytes("empty.nii.gz", all);
  listener l = {.stop_at = 8};
  GError *error = NULL;
  assert_null(open_listening("empty.nrrd", &l, &error));
  expect(error, TC_ERROR_CANCELLED, "cancelled");
  open_bad("empty.nii.gz", TC_ERROR_FORMAT, "");
  g_byte_array_unref(all);
  g_byte_array_unref(empty);
}

TEST(memory_is_asked_for_before_anything_is_decoded) {
  listener l = {.most = 1000};
  GError *error = NULL;
  write_bomb("large.nrrd", "NRRD0004\ntype: short\nendian: little\ndimension: 3\nsizes: 900 900 900\nencoding: bzip2\n\n",
             64);
  assert_null(open_listening("large.nrrd", &l, &error));
  expect(error, TC_ERROR_BUSY, "not now");
  assert_int_equal(l.asked, 0);
  assert_int_equal(l.reserved, 1);
  assert_int_equal(l.bytes, 900 * 900 * 900 * 2);
}

/* The demos too; what they ask for is what they take. */
TEST(what_is_asked_for_is_what_is_taken) {
  static const char *const names[] = {"head", "head-labels", "vessels", "marschner-lobb", "bucky"};
  for (size_t i = 0; i < G_N_ELEMENTS(names); i++) {
    g_autoptr(tc_volume) volume = tc_volume_demo(names[i], NULL);
    assert_int_equal(tc_volume_bytes(volume), tc_volume_demo_bytes(names[i]));
  }
  listener l = {.most = 1000};
  const tc_import_options options = {.reserve = on_reserve, .user = &l};
  GError *error = NULL;
  assert_null(tc_import("demo:bucky", &options, &error));
  expect(error, TC_ERROR_BUSY, "not now");
}

static bool stop_at_once(void *user) {
  ++*(int *)user;
  return false;
}

static void count(void *user) { ++*(int *)user; }

TEST(sealing_stops_and_freeing_is_told) {
  tc_volume_desc d = {.dims = {256, 256, 256}, .type = TC_U8, .spacing = {1, 1, 1}, .slope = 1,
                      .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
  int asked = 0, freed = 0;
  tc_volume *volume = tc_volume_new(&d, NULL);
  ((uint8_t *)tc_volume_voxels(volume))[256 * 256 * 256 - 1] = 9;
  assert_false(tc_volume_seal_while(volume, stop_at_once, &asked));
  assert_int_equal(asked, 1);
  assert_non_null(tc_volume_voxels(volume)); /* not sealed */
  tc_volume_seal(volume);
  assert_true(tc_volume_statistics(volume)->max == 9);
  tc_volume_when_freed(volume, count, &freed);
  tc_volume_unref(tc_volume_ref(volume));
  assert_int_equal(freed, 0);
  tc_volume_unref(volume);
  assert_int_equal(freed, 1);
}

/* ---- files that may name no other ---- */

static void refuse_alone(const char *name, const GByteArray *bytes) {
  const tc_import_options options = {.self_contained = true};
  GError *error = NULL;
  write_bytes(name, bytes);
  tc_volume *volume = open_with(name, &options, &error);
  if (volume) fail_msg("%s was opened with another file's voxels", name);
  expect(error, TC_ERROR_FORMAT, "names another file");
}

#define NAMES "type: uchar\ndimension: 3\nsizes: 4 4 4\nencoding: raw\ndata file: "

static void append(GByteArray *out, const char *text, size_t size) {
  g_byte_array_append(out, (const uint8_t *)text, (guint)size);
}

TEST(an_upload_reads_no_other_file) {
  static const char *const tails[] = {NAMES "secret.raw\n\n", NAMES "LIST\nsecret.raw\n", NAMES "sub/secret.raw\n\n",
                                      NAMES "secret%d.raw 1 1 1\n"};
  char secret[64] = "secret", *sub = path_of("sub");
  write_file("secret.raw", secret, sizeof secret);
  g_mkdir(sub, 0700);
  write_file("sub/secret.raw", secret, sizeof secret);
  g_free(sub);
  for (size_t i = 0; i < G_N_ELEMENTS(tails); i++)
    for (int padding = 0; padding < 3; padding++) {
      g_autoptr(GByteArray) file = g_byte_array_new();
      append(file, "NRRD0004\n", 9);
      if (padding == 1) append(file, "#\0\n", 3); /* a line with a zero byte */
      for (int line = 0; padding == 2 && line < 10000; line++)
        append(file, "# so long that a look at the beginning ends before\n", 51);
      append(file, tails[i], strlen(tails[i]));
      refuse_alone("spy.nrrd", file);
    }
  g_autoptr(GByteArray) meta = g_byte_array_new();
  append(meta, "ObjectType = Image\nComment = \0x\nNDims = 3\n", 42);
  append(meta, "DimSize = 4 4 4\nElementType = MET_UCHAR\nElementDataFile = secret.raw\n", 69);
  refuse_alone("spy.mhd", meta);
}

TEST(an_upload_of_one_piece_is_read) {
  const tc_import_options options = {.self_contained = true};
  char file[256] = SIZES_4 "encoding: raw\n\n";
  write_file("whole.nrrd", file, strlen(file) + 64);
  GError *error = NULL;
  g_autoptr(tc_volume) volume = open_with("whole.nrrd", &options, &error);
  assert_non_null(volume);
}

TESTS(make_folder, remove_folder)
