/* The smaller pieces of the DICOM reader: samples to voxels, the zip reader, the wire between helper and parent. */
#include "tests/support/test.h"
#include <limits.h>
#include <unistd.h>

#include "renderer/import/helper/dicom_pixels.h"
#include "renderer/import/wire.h"
#include "renderer/import/helper/dicom_zip.h"
#include "tests/support/dicom_files.h"

/* ---- samples ---- */

static tc_dicom_samples grey(int allocated, int stored, int high, bool is_signed) {
  return (tc_dicom_samples){.rows = 1,
                            .columns = 4,
                            .allocated = allocated,
                            .stored = stored,
                            .high = high,
                            .is_signed = is_signed,
                            .per_pixel = 1};
}

TEST(bits_outside_the_pixel_are_cut) {
  /* 12 bits stored at 11..0 with an overlay in the top bits, unsigned and signed. */
  const uint8_t bytes[8] = {0xff, 0xff, 0x00, 0xf8, 0x01, 0x10, 0x34, 0xa2};
  tc_dicom_samples s = grey(16, 12, 11, false);
  tc_dicom_target target = {.type = TC_U16};
  uint16_t u[4];
  assert_int_equal(tc_dicom_natural_type(&s), TC_U16);
  assert_true(tc_dicom_convert(&(tc_dicom_frame){s, bytes, sizeof bytes, 0}, &target, u));
  static const uint16_t want_u[4] = {0xfff, 0x800, 0x001, 0x234};
  assert_memory_equal(u, want_u, sizeof u);
  s = grey(16, 12, 11, true);
  int16_t i[4];
  target.type = tc_dicom_natural_type(&s);
  assert_int_equal(target.type, TC_I16);
  assert_true(tc_dicom_convert(&(tc_dicom_frame){s, bytes, sizeof bytes, 0}, &target, i));
  static const int16_t want_i[4] = {-1, -2048, 1, 0x234};
  assert_memory_equal(i, want_i, sizeof i);
  /* the same samples stored high, at 15..4 */
  const uint8_t shifted[8] = {0xf7, 0xff, 0x03, 0x80, 0x1f, 0x00, 0x40, 0x23};
  s = grey(16, 12, 15, true);
  assert_true(tc_dicom_convert(&(tc_dicom_frame){s, shifted, sizeof shifted, 0}, &target, i));
  assert_memory_equal(i, want_i, sizeof i);
}

TEST(every_width_converts) {
  const uint8_t bytes[32] = {0xfe, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 5};
  double want[4] = {-2, 5, 0, 0};
  tc_dicom_samples s = grey(64, 64, 63, true);
  tc_dicom_target target = {.type = TC_F32, .rescale = true, .slope = 2, .intercept = 1};
  float out[4];
  assert_true(tc_dicom_convert(&(tc_dicom_frame){s, bytes, sizeof bytes, 0}, &target, out));
  for (int i = 0; i < 4; i++)
    assert_true(out[i] == (float)(2 * want[i] + 1));
  double lo = INFINITY, hi = -INFINITY;
  assert_true(tc_dicom_range(&(tc_dicom_frame){s, bytes, sizeof bytes, 0}, &lo, &hi));
  assert_true(lo == -2 && hi == 5);
  const uint8_t narrow[4] = {0xff, 0x7f, 0x80, 0x00};
  int8_t i8[4];
  s = grey(8, 8, 7, true);
  target = (tc_dicom_target){.type = tc_dicom_natural_type(&s)};
  assert_int_equal(target.type, TC_I8);
  assert_true(tc_dicom_convert(&(tc_dicom_frame){s, narrow, 4, 0}, &target, i8));
  assert_true(i8[0] == -1 && i8[1] == 127 && i8[2] == -128 && i8[3] == 0);
  assert_false(tc_dicom_convert(&(tc_dicom_frame){s, narrow, 3, 0}, &target, i8));
}

TEST(single_bits_become_labels) {
  const uint8_t bytes[2] = {0x50, 0x01}; /* from bit 3: 0 1 0 1 */
  tc_dicom_samples s = grey(1, 1, 0, false);
  uint16_t out[4] = {9, 0, 9, 9};
  tc_overlaps overlaps;
  tc_overlaps_init(&overlaps, 9);
  assert_true(tc_dicom_stamp(&(tc_dicom_frame){s, bytes, 2, 3}, 1, 7, &overlaps, out));
  static const uint16_t want[4] = {9, 7, 9, 10}; /* voxels of no segment stay, and two have a label of their own */
  assert_memory_equal(out, want, sizeof want);
  assert_false(tc_dicom_stamp(&(tc_dicom_frame){s, bytes, 1, 5}, 1, 7, &overlaps, out));
  tc_overlaps_finish(&overlaps);
}

TEST(colours_become_luma) {
  const uint8_t pixels[12] = {255, 0, 0, 0, 255, 0, 0, 0, 255, 255, 255, 255};
  const uint8_t planes[12] = {255, 0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255};
  static const uint8_t want[4] = {54, 182, 18, 255}; /* 0.2126 0.7152 0.0722 of 255, rounded */
  tc_dicom_samples s = grey(8, 8, 7, false);
  tc_dicom_target target = {.type = TC_U8};
  uint8_t out[4];
  s.per_pixel = 3;
  s.colour = TC_DICOM_RGB;
  assert_true(tc_dicom_convert(&(tc_dicom_frame){s, pixels, 12, 0}, &target, out));
  assert_memory_equal(out, want, 4);
  s.planar = true;
  assert_true(tc_dicom_convert(&(tc_dicom_frame){s, planes, 12, 0}, &target, out));
  assert_memory_equal(out, want, 4);
}

TEST(odd_formats_are_not_valid) {
  tc_dicom_samples s = grey(16, 12, 11, false);
  assert_true(tc_dicom_samples_valid(&s));
  s = grey(16, 17, 16, false);
  assert_false(tc_dicom_samples_valid(&s));
  s = grey(16, 12, 10, false);
  assert_false(tc_dicom_samples_valid(&s));
  s = grey(24, 24, 23, false);
  assert_false(tc_dicom_samples_valid(&s));
  s = grey(8, 8, 7, false);
  s.rows = 0;
  assert_false(tc_dicom_samples_valid(&s));
  s.rows = 65535;
  s.columns = 65535;
  assert_true(tc_dicom_frame_bytes(&s) == UINT64_C(65535) * 65535);
}

/* ---- zip ---- */

static GByteArray *small_zip(void) {
  zip_writer z = zip_start();
  zip_add(&z, "../../etc/a", "stored bytes", 12, 0);
  zip_add(&z, "folder/", "", 0, 0);
  zip_add(&z, "b", "deflated deflated deflated deflated", 35, 8);
  return zip_end(&z);
}

TEST(zip_members_read_back) {
  GByteArray *b = small_zip();
  tc_dicom_zip zip;
  uint8_t out[64];
  size_t got;
  assert_true(tc_dicom_zip_open(&zip, b->data, b->len, NULL));
  assert_int_equal(zip.count, 3);
  assert_false(zip.members[1].usable);
  assert_true(tc_dicom_zip_read(&zip, 0, out, sizeof out, &got, NULL));
  assert_int_equal(got, 12);
  assert_memory_equal(out, "stored bytes", 12);
  assert_true(tc_dicom_zip_read(&zip, 2, out, sizeof out, &got, NULL));
  assert_int_equal(got, 35);
  assert_memory_equal(out, "deflated deflated deflated deflated", 35);
  assert_true(tc_dicom_zip_read(&zip, 2, out, 8, &got, NULL));
  assert_int_equal(got, 8);
  assert_false(tc_dicom_zip_read(&zip, 1, out, 8, &got, NULL));
  assert_false(tc_dicom_zip_read(&zip, 3, out, 8, &got, NULL));
  tc_dicom_zip_finish(&zip);
  g_byte_array_free(b, TRUE);
}

static void read_all_members(const uint8_t *bytes, size_t size) {
  tc_dicom_zip zip;
  if (!tc_dicom_zip_open(&zip, bytes, size, NULL)) return;
  for (size_t i = 0; i < zip.count; i++) {
    size_t got, want = zip.members[i].size < 4096 ? zip.members[i].size : 4096;
    g_autofree uint8_t *out = g_malloc(want + 1);
    tc_dicom_zip_read(&zip, i, out, want, &got, NULL);
  }
  tc_dicom_zip_finish(&zip);
}

TEST(damaged_zips_are_errors) {
  GByteArray *b = small_zip();
  for (guint n = 0; n < b->len; n++) { /* no prefix is a zip; the copy is exact so that an over-read is seen */
    g_autofree uint8_t *cut = g_memdup2(b->data, n);
    tc_dicom_zip zip;
    g_autoptr(GError) error = NULL;
    assert_false(tc_dicom_zip_open(&zip, cut, n, &error));
    assert_non_null(error);
  }
  for (guint n = 0; n < b->len; n++)
    for (int bit = 0; bit < 8; bit++) {
      g_autofree uint8_t *bad = g_memdup2(b->data, b->len);
      bad[n] ^= (uint8_t)(1 << bit);
      read_all_members(bad, b->len);
    }
  g_byte_array_free(b, TRUE);
}

TEST(a_wrong_checksum_is_seen) {
  GByteArray *b = small_zip();
  tc_dicom_zip zip;
  uint8_t out[64];
  size_t got;
  GError *error = NULL;
  memcpy(b->data + 30 + strlen("../../etc/a"), "STORED", 6);
  assert_true(tc_dicom_zip_open(&zip, b->data, b->len, NULL));
  assert_false(tc_dicom_zip_read(&zip, 0, out, sizeof out, &got, &error));
  assert_non_null(strstr(error->message, "checksum"));
  g_error_free(error);
  tc_dicom_zip_finish(&zip);
  g_byte_array_free(b, TRUE);
}

/* ---- wire ---- */

typedef struct memory {
  const uint8_t *bytes;
  size_t size, at;
} memory;

static bool read_memory(void *user, void *bytes, size_t size, GError **error) {
  memory *m = user;
  if (size > m->size - m->at) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "end");
    return false;
  }
  memcpy(bytes, m->bytes + m->at, size);
  m->at += size;
  return true;
}

static tc_volume_desc small_desc(void) {
  return (tc_volume_desc){.dims = {3, 2, 2},
                          .type = TC_I16,
                          .spacing = {1, 2, 3},
                          .origin = {4, 5, 6},
                          .direction = {1, 0, 0, 0, 1, 0, 0, 0, 1},
                          .slope = 2,
                          .intercept = -3,
                          .frames = 4,
                          .modality = "CT",
                          .unit = "HU",
                          .format = "dicom",
                          .note = "a note",
                          .window_center = 40,
                          .window_width = 400};
}

static const tc_provenance small_from = {
    .volume = 3, .slices_used = 2, .slices_found = 8, .bridged = 2, .resampled = true};

/* What both share: the voxels are put here. */
static uint8_t ring[TC_WIRE_RING_BYTES];

static void no_reply(void *user, char what, int fd) {}

/* What a good helper says about a small volume; the bytes end up in a buffer by way of a pipe. */
static size_t say(uint8_t *out, size_t room, const tc_volume_desc *desc, const tc_provenance *from,
                  size_t voxel_bytes) {
  int fd[2];
  for (int i = 0; i < 64; i++)
    ((int16_t *)(void *)(ring + TC_WIRE_SLOT_BYTES))[i] = (int16_t)(i - 5);
  assert_int_equal(pipe(fd), 0);
  assert_true(tc_wire_send_progress(fd[1], 0.5));
  assert_true(tc_wire_send_head(fd[1], desc, from));
  assert_true(tc_wire_send_voxels(fd[1], 1, voxel_bytes));
  assert_true(tc_wire_send_end(fd[1]));
  close(fd[1]);
  ssize_t n = read(fd[0], out, room);
  close(fd[0]);
  assert_true(n > 0);
  return (size_t)n;
}

static tc_volume *hear(const uint8_t *bytes, size_t size, uint64_t most, GError **error) {
  memory m = {bytes, size, 0};
  tc_wire_reader reader = {.read = read_memory, .user = &m, .reply = no_reply, .ring = ring, .max_voxel_bytes = most};
  return tc_wire_load(&reader, error);
}

TEST(a_volume_crosses_the_wire) {
  uint8_t bytes[2048];
  tc_volume_desc desc = small_desc();
  size_t n = say(bytes, sizeof bytes, &desc, &small_from, 24);
  tc_volume *v = hear(bytes, n, 0, NULL);
  assert_non_null(v);
  const tc_volume_desc *d = tc_volume_describe(v);
  assert_memory_equal(d->dims, desc.dims, sizeof desc.dims);
  assert_memory_equal(d->spacing, desc.spacing, sizeof desc.spacing);
  assert_memory_equal(d->origin, desc.origin, sizeof desc.origin);
  assert_memory_equal(d->direction, desc.direction, sizeof desc.direction);
  assert_true(d->slope == 2 && d->intercept == -3 && d->frames == 4 && d->window_center == 40 &&
              d->window_width == 400);
  const tc_provenance *from = tc_volume_provenance(v);
  assert_true(from->volume == 3 && from->slices_used == 2 && from->slices_found == 8 && from->bridged == 2 &&
              from->resampled);
  assert_string_equal(d->modality, "CT");
  assert_string_equal(d->unit, "HU");
  assert_string_equal(d->note, "a note");
  assert_string_equal(d->format, "dicom");
  for (int i = 0; i < 12; i++)
    assert_int_equal(((const int16_t *)tc_volume_data(v))[i], i - 5);
  tc_volume_unref(v);
  GError *error = NULL;
  assert_null(hear(bytes, n, 23, &error));
  assert_int_equal(error->code, TC_ERROR_LIMIT);
  g_error_free(error);
  for (size_t cut = 0; cut < n; cut++) {
    g_autofree uint8_t *part = g_memdup2(bytes, cut);
    assert_null(hear(part, cut, 0, NULL));
  }
}

TEST(lies_about_the_volume_are_refused) {
  uint8_t bytes[2048];
  tc_volume_desc good = small_desc();
  for (int lie = 0; lie < 19; lie++) {
    tc_volume_desc d = good;
    tc_provenance from = small_from;
    size_t voxels = 24;
    if (lie == 0) d.dims[1] = 0;
    if (lie == 1) d.dims[2] = -7;
    if (lie == 2) d.dims[0] = d.dims[1] = d.dims[2] = 1 << 20;
    if (lie == 3) d.type = (tc_voxel_type)99;
    if (lie == 4) d.spacing[0] = NAN;
    if (lie == 5) d.spacing[1] = 0;
    if (lie == 6) d.origin[2] = INFINITY;
    if (lie == 7) d.direction[0] = 5;
    if (lie == 8) d.slope = 0;
    if (lie == 9) d.intercept = NAN;
    if (lie == 10) d.frames = 0;
    if (lie == 11) d.window_width = -1;
    if (lie == 12) voxels = 22;
    if (lie == 13) voxels = 26;
    if (lie == 14) from.volume = 5;
    if (lie == 15) from.slices_used = 9;
    if (lie == 16) from.bridged = 3;
    if (lie == 17) from.slices_found = -1;
    if (lie == 18) strcpy(d.format, "a b");
    size_t n = say(bytes, sizeof bytes, &d, &from, voxels);
    g_autoptr(GError) error = NULL;
    if (hear(bytes, n, 0, &error)) fail_msg("lie %d was believed", lie);
    assert_non_null(error);
  }
}

TEST(text_from_the_helper_is_tamed) {
  int fd[2];
  uint8_t bytes[1024];
  assert_int_equal(pipe(fd), 0);
  assert_true(tc_wire_send_fail(fd[1], TC_ERROR_CANCELLED, "two\nlines \x1b[31m\xff"));
  close(fd[1]);
  ssize_t n = read(fd[0], bytes, sizeof bytes);
  close(fd[0]);
  g_autoptr(GError) error = NULL;
  assert_null(hear(bytes, (size_t)n, 0, &error));
  assert_int_equal(error->code, TC_ERROR_FORMAT); /* only codes about files pass */
  assert_string_equal(error->message, "two?lines ?[31m?");
}

TEST(slots_that_are_none_are_refused) {
  static const struct { unsigned slot; size_t bytes; } lies[] = {{TC_WIRE_SLOTS, 24}, {UINT_MAX, 24}, {0, 25},
                                                                 {0, TC_WIRE_SLOT_BYTES + 1}};
  for (size_t i = 0; i < G_N_ELEMENTS(lies); i++) {
    uint8_t bytes[2048];
    tc_volume_desc desc = small_desc();
    int fd[2];
    g_autoptr(GError) error = NULL;
    assert_int_equal(pipe(fd), 0);
    assert_true(tc_wire_send_head(fd[1], &desc, &small_from));
    assert_true(tc_wire_send_voxels(fd[1], lies[i].slot, lies[i].bytes));
    assert_true(tc_wire_send_end(fd[1]));
    close(fd[1]);
    const ssize_t n = read(fd[0], bytes, sizeof bytes);
    close(fd[0]);
    assert_null(hear(bytes, (size_t)n, 0, &error));
    assert_int_equal(error->code, TC_ERROR_FORMAT);
  }
}

static bool never(void *user, double fraction) { return false; }

TEST(the_caller_can_cancel) {
  uint8_t bytes[2048];
  tc_volume_desc desc = small_desc();
  memory m = {bytes, say(bytes, sizeof bytes, &desc, &small_from, 24), 0};
  tc_wire_reader reader = {.read = read_memory, .user = &m, .reply = no_reply, .ring = ring, .tick = never};
  g_autoptr(GError) error = NULL;
  assert_null(tc_wire_load(&reader, &error));
  assert_int_equal(error->code, TC_ERROR_CANCELLED);
}

TESTS(NULL, NULL)
