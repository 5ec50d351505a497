/* Files for the import tests: a folder that goes away, byte strings in either byte order, compression. */
#ifndef TC_TEST_IMPORT_FILES_H
#define TC_TEST_IMPORT_FILES_H

#include "tests/support/test.h"

#include <bzlib.h>
#include <glib.h>
#include <glib/gstdio.h>
#include <unistd.h>
#include <zip.h>
#include <zlib.h>

#include "renderer/import/helper/convert.h"
#include "renderer/import/import.h"
#include "tests/support/folder.h"
#include "tests/support/read_here.h"
#include "tests/support/scoped.h"

static inline char *path_of(const char *name) { return g_build_filename(folder, name, NULL); }

static inline void write_file(const char *name, const void *bytes, size_t size) {
  g_autofree char *path = path_of(name);
  FILE *file = fopen(path, "wb"); /* not g_file_set_contents(), which waits for the disk */
  assert_non_null(file);
  if (size > 0) assert_int_equal(fwrite(bytes, 1, size, file), size);
  assert_int_equal(fclose(file), 0);
}

static inline void write_bytes(const char *name, const GByteArray *bytes) { write_file(name, bytes->data, bytes->len); }

static inline void write_text(const char *name, const char *text) { write_file(name, text, strlen(text)); }

/* In this process, but for what only tc_import() knows: a choice behind '#', and what a file may name. */
#ifndef TC_TEST_BY_HELPER
#define TC_TEST_BY_HELPER(name, options) (strchr(name, '#') || ((options) && (options)->self_contained))
#endif

/* A zip of files that were written, in a folder of its own. */
static inline void zip_files(const char *name, const char *const *files, int count) {
  g_autofree char *path = path_of(name);
  zip_t *zip = zip_open(path, ZIP_CREATE | ZIP_TRUNCATE, NULL);
  for (int i = 0; i < count; i++) {
    char *file = path_of(files[i]), *member = g_strconcat("study/", files[i], NULL);
    assert_true(zip_file_add(zip, member, zip_source_file(zip, file, 0, -1), 0) >= 0);
    g_free(member);
    g_free(file);
  }
  assert_int_equal(zip_close(zip), 0);
}

static inline tc_volume *open_with(const char *name, const tc_import_options *options, GError **error) {
  g_autofree char *path = path_of(name);
  tc_volume *volume = TC_TEST_BY_HELPER(name, options) ? tc_import(path, options, error) : read_file_here(path, options, error);
  return volume;
}

/* Opens a file that must open. */
static inline tc_volume *open_good(const char *name) {
  GError *error = NULL;
  tc_volume *volume = open_with(name, NULL, &error);
  if (error) print_error("%s\n", error->message);
  assert_null(error);
  assert_non_null(volume);
  return volume;
}

/* Opens a file that must be refused with this code and, in the message, this text. */
static inline void open_bad(const char *name, int code, const char *text) {
  g_autoptr(GError) error = NULL;
  tc_volume *volume = open_with(name, NULL, &error);
  assert_null(volume);
  assert_non_null(error);
  bool right = error->domain == TC_ERROR && error->code == code && strstr(error->message, text) != NULL;
  if (!right) print_error("wanted [%d] ...%s..., got [%d] %s\n", code, text, error->code, error->message);
  assert_true(right);
  assert_null(strchr(error->message, '\n'));
  assert_null(strstr(error->message, folder)); /* no server-side folder in a message */
}

/* ---- bytes ---- */

static inline void put_uint(GByteArray *out, uint64_t value, size_t size, bool big) {
  for (size_t i = 0; i < size; i++) {
    uint8_t byte = (uint8_t)(value >> 8 * (big ? size - 1 - i : i));
    g_byte_array_append(out, &byte, 1);
  }
}

/* A number as an element of the file. */
static inline void put_element(GByteArray *out, tc_element element, double value, bool big) {
  uint64_t bits;
  float narrow = (float)value;
  uint32_t narrow_bits;
  if (element == TC_ELEMENT_F32) {
    memcpy(&narrow_bits, &narrow, sizeof narrow_bits);
    bits = narrow_bits;
  } else if (element == TC_ELEMENT_F64) {
    memcpy(&bits, &value, sizeof bits);
  } else {
    bits = value < 0 ? (uint64_t)(int64_t)value : (uint64_t)value;
  }
  put_uint(out, bits, tc_element_size(element), big);
}

static inline void put_at(GByteArray *out, size_t at, uint64_t value, size_t size, bool big) {
  for (size_t i = 0; i < size; i++) out->data[at + i] = (uint8_t)(value >> 8 * (big ? size - 1 - i : i));
}

static inline void put_f32_at(GByteArray *out, size_t at, float value, bool big) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  put_at(out, at, bits, 4, big);
}

static inline void put_f64_at(GByteArray *out, size_t at, double value, bool big) {
  uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  put_at(out, at, bits, 8, big);
}

/* ---- compression ---- */

static inline GByteArray *deflated(const void *bytes, size_t size, bool gzip) {
  z_stream z = {0};
  assert_int_equal(deflateInit2(&z, 6, Z_DEFLATED, MAX_WBITS + (gzip ? 16 : 0), 8, Z_DEFAULT_STRATEGY), Z_OK);
  GByteArray *out = g_byte_array_new();
  g_byte_array_set_size(out, (guint)deflateBound(&z, size) + 32);
  z.next_in = (Bytef *)bytes;
  z.avail_in = (uInt)size;
  z.next_out = out->data;
  z.avail_out = out->len;
  assert_int_equal(deflate(&z, Z_FINISH), Z_STREAM_END);
  g_byte_array_set_size(out, (guint)z.total_out);
  deflateEnd(&z);
  return out;
}

static inline GByteArray *bzipped(const void *bytes, size_t size) {
  unsigned length = (unsigned)size + (unsigned)size / 50 + 1024;
  GByteArray *out = g_byte_array_new();
  g_byte_array_set_size(out, length);
  assert_int_equal(BZ2_bzBuffToBuffCompress((char *)out->data, &length, (char *)bytes, (unsigned)size, 9, 0, 0), BZ_OK);
  g_byte_array_set_size(out, length);
  return out;
}

/* Header text, then data. */
static inline GByteArray *with_header(const char *header, const GByteArray *data) {
  GByteArray *out = g_byte_array_new();
  g_byte_array_append(out, (const uint8_t *)header, (guint)strlen(header));
  if (data) g_byte_array_append(out, data->data, data->len);
  return out;
}

/* ---- looking at volumes ---- */

static inline double voxel(const tc_volume *volume, size_t index) {
  const void *data = tc_volume_data(volume);
  switch (tc_volume_describe(volume)->type) {
  case TC_U8: return ((const uint8_t *)data)[index];
  case TC_I8: return ((const int8_t *)data)[index];
  case TC_U16: return ((const uint16_t *)data)[index];
  case TC_I16: return ((const int16_t *)data)[index];
  case TC_F32: return ((const float *)data)[index];
  case TC_VOXEL_TYPE_COUNT: break;
  }
  return NAN;
}

static inline void check_near(const double *got, const double *wanted, int n, double eps) {
  for (int i = 0; i < n; i++) {
    if (!(fabs(got[i] - wanted[i]) <= eps)) print_error("value %d: %.12g, expected %.12g\n", i, got[i], wanted[i]);
    assert_true(fabs(got[i] - wanted[i]) <= eps);
  }
}

static inline void check_dims(const tc_volume *volume, int x, int y, int z) {
  const int *dims = tc_volume_describe(volume)->dims;
  assert_int_equal(dims[0], x);
  assert_int_equal(dims[1], y);
  assert_int_equal(dims[2], z);
}

/* Every prefix of a small file must end in one clean error, and the whole in a volume. The file is named so that its
 * format is known even when the content says nothing yet. */
static inline void check_prefixes(const char *name, const GByteArray *whole) {
  for (guint n = 0; n < whole->len; n++) {
    g_autoptr(GError) error = NULL;
    write_file(name, whole->data, n);
    tc_volume *volume = open_with(name, NULL, &error);
    if (volume) print_error("%s: a prefix of %u of %u bytes opened\n", name, n, whole->len);
    assert_null(volume);
    assert_non_null(error);
  }
  write_bytes(name, whole);
  tc_volume_unref(open_good(name));
}

#endif
