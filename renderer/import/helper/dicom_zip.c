/* Reads members of a zip in memory through libzip. */
#include "renderer/import/helper/dicom_zip.h"

#include <string.h>
#include <zip.h>
#include <zlib.h>

enum { DEFLATE_RATIO = 1032 }; /* deflate's largest expansion */

static bool fail(GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "zip: %s", what);
  return false;
}

/* Checks the uncompressed size against the compressed size, so that a small file cannot ask for much memory. */
static tc_dicom_zip_member describe(zip_t *archive, size_t index, size_t file_size) {
  const zip_uint64_t wanted =
      ZIP_STAT_NAME | ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD | ZIP_STAT_ENCRYPTION_METHOD;
  zip_stat_t s;
  if (zip_stat_index(archive, index, ZIP_FL_ENC_RAW, &s) != 0 || (s.valid & wanted) != wanted)
    return (tc_dicom_zip_member){0};
  const size_t name = strlen(s.name);
  const bool folder = name > 0 && s.name[name - 1] == '/';
  const bool stored = s.comp_method == ZIP_CM_STORE && s.size == s.comp_size;
  const bool deflated = s.comp_method == ZIP_CM_DEFLATE && s.size / DEFLATE_RATIO <= s.comp_size;
  const bool usable = !folder && s.encryption_method == ZIP_EM_NONE && s.comp_size <= file_size && (stored || deflated);
  return (tc_dicom_zip_member){s.size, usable};
}

bool tc_dicom_zip_open(tc_dicom_zip *zip, const void *bytes, size_t size, GError **error) {
  zip_source_t *source =
      size ? zip_source_buffer_create(bytes, size, 0, NULL) : NULL; /* libzip accepts an empty buffer as a zip without members */
  *zip = (tc_dicom_zip){.archive = source ? zip_open_from_source(source, ZIP_RDONLY, NULL) : NULL};
  if (!zip->archive) {
    zip_source_free(source);
    return fail(error, "no directory at the end, or a damaged one; the file is cut or no zip");
  }
  const zip_int64_t count = zip_get_num_entries(zip->archive, 0);
  if (count > TC_DICOM_ZIP_MEMBERS_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "zip: more than %d members", TC_DICOM_ZIP_MEMBERS_MAX);
    tc_dicom_zip_finish(zip);
    return false;
  }
  zip->count = (size_t)count;
  zip->members = g_new0(tc_dicom_zip_member, zip->count + 1);
  for (size_t i = 0; i < zip->count; i++) zip->members[i] = describe(zip->archive, i, size);
  return true;
}

void tc_dicom_zip_finish(tc_dicom_zip *zip) {
  if (zip->archive) zip_discard(zip->archive);
  g_free(zip->members);
  *zip = (tc_dicom_zip){0};
}

/* libzip compares the checksum when it reaches the end, so this reads one byte beyond the last. */
static bool read_member(zip_file_t *file, uint8_t *out, size_t want, bool all, GError **error) {
  uint8_t behind;
  const zip_int64_t got = zip_fread(file, out, want);
  if (got >= 0 && (size_t)got < want) return fail(error, "member is shorter than announced");
  const zip_int64_t more = all && got >= 0 ? zip_fread(file, &behind, 1) : 0;
  const bool checksum = zip_error_code_zip(zip_file_get_error(file)) == ZIP_ER_CRC;
  if (got < 0 || more != 0) return fail(error, checksum ? "checksum of a member is wrong" : "damaged member");
  return true;
}

bool tc_dicom_zip_read(const tc_dicom_zip *zip, size_t member, uint8_t *out, size_t want, size_t *got, GError **error) {
  *got = 0;
  if (member >= zip->count || !zip->members[member].usable)
    return fail(error, "member cannot be read (encrypted or packed in a way not known)");
  const bool all = want >= zip->members[member].size;
  if (all) want = (size_t)zip->members[member].size;
  zip_file_t *file = zip_fopen_index(zip->archive, member, 0);
  if (!file) return fail(error, "member outside the file");
  const bool good = read_member(file, out, want, all, error);
  if (good) *got = want;
  zip_fclose(file);
  return good;
}

bool tc_dicom_deflate_is_whole(const uint8_t *bytes, size_t size) {
  uint8_t scratch[16384];
  z_stream z = {0};
  int state = Z_OK;
  if (inflateInit2(&z, -MAX_WBITS) != Z_OK) return false;
  for (size_t in = 0; state == Z_OK;) {
    if (z.avail_in == 0) {
      size_t n = size - in < (1u << 30) ? size - in : 1u << 30;
      z.next_in = (Bytef *)(uintptr_t)(bytes + in);
      z.avail_in = (uInt)n;
      in += n;
    }
    z.next_out = scratch;
    z.avail_out = sizeof scratch;
    state = inflate(&z, Z_NO_FLUSH);
  }
  inflateEnd(&z);
  return state == Z_STREAM_END;
}

const char *tc_dicom_zip_name(const tc_dicom_zip *zip, size_t member) {
  const char *name = zip_get_name(zip->archive, member, ZIP_FL_ENC_RAW);
  return name ? name : "";
}
