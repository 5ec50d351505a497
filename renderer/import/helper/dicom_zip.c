/* The bounded zip reader. Layout after PKWARE's APPNOTE 6.3.9, sections 4.3 and 4.4. */
#include "renderer/import/helper/dicom_zip.h"

#include <string.h>
#include <zlib.h>

#include "renderer/import/reader.h"

enum {
  END_MARK = 0x06054b50,
  END_BYTES = 22,
  COMMENT_MAX = 65535,
  END64_MARK = 0x06064b50,
  END64_BYTES = 56,
  LOCATOR_MARK = 0x07064b50,
  LOCATOR_BYTES = 20,
  ENTRY_MARK = 0x02014b50,
  ENTRY_BYTES = 46,
  LOCAL_MARK = 0x04034b50,
  LOCAL_BYTES = 30,
  STORED = 0,
  DEFLATED = 8,
  DEFLATE_RATIO = 1032, /* the most deflate can expand */
};

static bool fail(GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "zip: %s", what);
  return false;
}

/* The end record is the last thing but for a comment: searched backwards. */
static bool find_end(const tc_dicom_zip *zip, size_t *at) {
  if (zip->size < END_BYTES) return false;
  size_t last = zip->size - END_BYTES, stop = last > COMMENT_MAX ? last - COMMENT_MAX : 0;
  for (size_t i = last + 1; i-- > stop;) {
    const uint8_t *b = zip->bytes + i;
    if (b[0] == 'P' && b[1] == 'K' && b[2] == 5 && b[3] == 6) {
      *at = i;
      return true;
    }
  }
  return false;
}

/* Where the directory is and how many entries it has; follows zip64 where the short fields are full. */
static bool read_end(const tc_dicom_zip *zip, uint64_t *entries, uint64_t *size, uint64_t *start) {
  size_t at;
  tc_reader r;
  if (!find_end(zip, &at)) return false;
  tc_reader_init(&r, zip->bytes, zip->size, false);
  tc_reader_seek(&r, at + 10);
  *entries = tc_reader_u16(&r);
  *size = tc_reader_u32(&r);
  *start = tc_reader_u32(&r);
  if (*entries != 0xffff && *size != 0xffffffff && *start != 0xffffffff) return !r.failed;
  if (at < LOCATOR_BYTES) return false;
  tc_reader_seek(&r, at - LOCATOR_BYTES);
  if (tc_reader_u32(&r) != LOCATOR_MARK) return !r.failed; /* full fields by chance */
  tc_reader_u32(&r);
  uint64_t end64 = tc_reader_u64(&r);
  if (end64 > zip->size || zip->size - end64 < END64_BYTES) return false;
  tc_reader_seek(&r, (size_t)end64);
  if (tc_reader_u32(&r) != END64_MARK) return false;
  tc_reader_seek(&r, (size_t)end64 + 32);
  *entries = tc_reader_u64(&r);
  *size = tc_reader_u64(&r);
  *start = tc_reader_u64(&r);
  return !r.failed;
}

/* The zip64 extra field replaces, in this order, whichever of size, packed size and position is full. */
static void read_extra64(tc_reader *r, size_t length, tc_dicom_zip_member *m) {
  size_t end = r->at + length;
  while (!r->failed && r->at + 4 <= end) {
    uint16_t id = tc_reader_u16(r), bytes = tc_reader_u16(r);
    size_t next = r->at + bytes;
    if (id == 1 && next <= end) {
      if (m->size == 0xffffffff && r->at + 8 <= next) m->size = tc_reader_u64(r);
      if (m->packed == 0xffffffff && r->at + 8 <= next) m->packed = tc_reader_u64(r);
      if (m->at == 0xffffffff && r->at + 8 <= next) m->at = tc_reader_u64(r);
      return;
    }
    tc_reader_seek(r, next);
  }
}

static bool size_is_possible(const tc_dicom_zip *zip, const tc_dicom_zip_member *m) {
  if (m->at > zip->size || m->packed > zip->size - m->at) return false;
  if (m->method == STORED) return m->size == m->packed;
  return m->size <= m->packed * DEFLATE_RATIO + 64;
}

static bool read_entry(const tc_dicom_zip *zip, tc_reader *r, tc_dicom_zip_member *m) {
  size_t start = r->at;
  if (tc_reader_u32(r) != ENTRY_MARK) return false;
  tc_reader_seek(r, start + 8);
  uint16_t flags = tc_reader_u16(r);
  m->method = tc_reader_u16(r);
  tc_reader_seek(r, start + 16);
  m->crc = tc_reader_u32(r);
  m->packed = tc_reader_u32(r);
  m->size = tc_reader_u32(r);
  uint16_t name = tc_reader_u16(r), extra = tc_reader_u16(r), comment = tc_reader_u16(r);
  tc_reader_seek(r, start + 42);
  m->at = tc_reader_u32(r);
  size_t name_at = start + ENTRY_BYTES, extra_at = name_at + name;
  tc_reader_seek(r, extra_at);
  if (r->failed) return false;
  bool folder = name > 0 && r->bytes[name_at + name - 1] == '/';
  read_extra64(r, extra, m);
  bool encrypted = flags & 1;
  m->usable = !folder && !encrypted && (m->method == STORED || m->method == DEFLATED) && size_is_possible(zip, m);
  tc_reader_seek(r, extra_at + extra + comment);
  return !r->failed;
}

bool tc_dicom_zip_open(tc_dicom_zip *zip, const void *bytes, size_t size, GError **error) {
  uint64_t entries, length, start;
  *zip = (tc_dicom_zip){.bytes = bytes, .size = size};
  if (!read_end(zip, &entries, &length, &start))
    return fail(error, "no directory at the end; the file is cut or no zip");
  if (start > size || length > size - start || entries > length / ENTRY_BYTES)
    return fail(error, "directory outside the file");
  if (entries > TC_DICOM_ZIP_MEMBERS_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "zip: more than %d members", TC_DICOM_ZIP_MEMBERS_MAX);
    return false;
  }
  zip->members = g_new0(tc_dicom_zip_member, entries + 1);
  tc_reader r;
  tc_reader_init(&r, bytes, (size_t)(start + length), false);
  tc_reader_seek(&r, (size_t)start);
  for (uint64_t i = 0; i < entries; i++) {
    if (!read_entry(zip, &r, &zip->members[i])) {
      tc_dicom_zip_finish(zip);
      return fail(error, "damaged directory");
    }
    zip->count++;
  }
  return true;
}

void tc_dicom_zip_finish(tc_dicom_zip *zip) {
  g_free(zip->members);
  *zip = (tc_dicom_zip){0};
}

/* Inflates up to `want` bytes; fewer only where the stream ends. */
static bool inflate_some(const uint8_t *packed, size_t packed_size, uint8_t *out, size_t want, size_t *got,
                         GError **error) {
  z_stream z = {0};
  if (inflateInit2(&z, -MAX_WBITS) != Z_OK) return fail(error, "no memory to inflate");
  int state = Z_OK;
  size_t in = 0, done = 0;
  while (state == Z_OK && done < want) {
    if (z.avail_in == 0 && in < packed_size) {
      size_t n = packed_size - in < (1u << 30) ? packed_size - in : 1u << 30;
      z.next_in = (Bytef *)(uintptr_t)(packed + in); /* zlib's old signature; it does not write there */
      z.avail_in = (uInt)n;
      in += n;
    }
    size_t room = want - done < (1u << 30) ? want - done : 1u << 30;
    z.next_out = out + done;
    z.avail_out = (uInt)room;
    state = inflate(&z, Z_NO_FLUSH);
    done += room - z.avail_out;
  }
  inflateEnd(&z);
  *got = done;
  return state == Z_OK || state == Z_STREAM_END ? true : fail(error, "damaged member");
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

bool tc_dicom_zip_read(const tc_dicom_zip *zip, size_t member, uint8_t *out, size_t want, size_t *got, GError **error) {
  *got = 0;
  if (member >= zip->count || !zip->members[member].usable)
    return fail(error, "member cannot be read (encrypted or packed in"
                       " a way not known)");
  const tc_dicom_zip_member *m = &zip->members[member];
  tc_reader r;
  tc_reader_init(&r, zip->bytes, zip->size, false);
  tc_reader_seek(&r, (size_t)m->at);
  bool local = tc_reader_u32(&r) == LOCAL_MARK;
  tc_reader_seek(&r, (size_t)m->at + 26);
  size_t name = tc_reader_u16(&r), extra = tc_reader_u16(&r);
  tc_reader_seek(&r, (size_t)m->at + LOCAL_BYTES + name + extra);
  if (!local || r.failed || tc_reader_left(&r) < m->packed) return fail(error, "member outside the file");
  const uint8_t *packed = zip->bytes + r.at;
  bool all = want >= m->size;
  if (all) want = (size_t)m->size;
  if (m->method == STORED) {
    memcpy(out, packed, want);
    *got = want;
  } else if (!inflate_some(packed, (size_t)m->packed, out, want, got, error)) {
    return false;
  }
  if (*got != want) return fail(error, "member is shorter than announced");
  if (all && (uint32_t)crc32_z(0, out, want) != m->crc) return fail(error, "checksum of a member is wrong");
  return true;
}
