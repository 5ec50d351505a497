/* Model files (VMD.md). Assumes a little-endian machine. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "renderer/import/reader.h"
#include "renderer/splat/vmd.h"

#define DEFLATED 1 /* flags */
#define DIFFERENCES 2
#define MOST_INFLATED 1032 /* largest ratio of deflate */

/* ---- writing ---- */

static void put(GByteArray *to, const void *bytes, size_t size) { g_byte_array_append(to, bytes, (guint)size); }
static void put_u16(GByteArray *to, int value) { put(to, &(uint16_t){(uint16_t)value}, 2); }
static void put_u32(GByteArray *to, uint32_t value) { put(to, &value, 4); }

static void put_text(GByteArray *to, const char *text) {
  char field[16] = "";
  g_strlcpy(field, text, sizeof field);
  put(to, field, sizeof field);
}

static void put_head(GByteArray *to, const tc_vmd *v, int flags, uint64_t body, uint64_t stored) {
  const tc_vmd_head *h = &v->head;
  const tc_volume_desc *d = &h->grid;
  put(to, "TVMD", 4);
  put_u16(to, v->version);
  put_u16(to, flags);
  put(to, d->dims, sizeof d->dims);
  put(to, v->first, sizeof v->first);
  put(to, v->size, sizeof v->size);
  put_u32(to, v->columns);
  put(to, &v->voxels, 8);
  put(to, &body, 8);
  put(to, &stored, 8);
  put(to, d->spacing, sizeof d->spacing);
  put(to, d->origin, sizeof d->origin);
  put(to, d->direction, sizeof d->direction);
  put(to, &d->slope, 8);
  put(to, &d->intercept, 8);
  put_text(to, d->modality);
  put_text(to, d->unit);
  put_u16(to, h->n_attributes);
  put_u16(to, h->record_bytes);
  put_u16(to, h->n_palette);
  put_u16(to, 0);
  for (int i = 0; i < h->n_attributes; i++) {
    put_text(to, h->attributes[i].name);
    put_u16(to, h->attributes[i].type);
    put_u16(to, (int)tc_vmd_type_size(h->attributes[i].type));
  }
  put(to, h->palette, (size_t)h->n_palette * sizeof h->palette[0]);
}

/* The columns' lengths, then the columns. */
static GByteArray *body_of(const tc_vmd *v) {
  GByteArray *body = g_byte_array_new();
  const size_t cells = (size_t)v->size[0] * (size_t)v->size[1];
  uint32_t column = 0;
  for (size_t i = 0; i < cells; i++) {
    bool there = v->there[i / 64] >> i % 64 & 1;
    tc_vmd_put_varint(body, there ? tc_vmd_start(v, column + 1) - tc_vmd_start(v, column) : 0);
    column += there;
  }
  put(body, v->bytes, tc_vmd_start(v, v->columns));
  return body;
}

/* Subtracts (back: adds) the number of the preceding record, of 1, 2 or 4 bytes, modulo its width. */
static void difference(uint8_t *at, uint8_t *before, size_t size, bool back) {
  uint32_t number = 0, last = 0;
  memcpy(&number, at, size);
  memcpy(&last, before, size);
  const uint32_t other = back ? number + last : number - last;
  memcpy(before, back ? &other : &number, size);
  memcpy(at, &other, size);
}

/* Replaces the records in `bytes`, the model's or a copy, by their differences, or the reverse. */
static void take_differences(const tc_vmd *v, uint8_t *bytes, bool back) {
  uint8_t before[4 * TC_VMD_ATTRIBUTES] = {0};
  for (uint32_t c = 0; c < v->columns; c++)
    for (tc_vmd_run run = {.at = v->bytes + tc_vmd_start(v, c)}; tc_vmd_next(v, &run);)
      for (int i = 0; i < run.stored; i++)
        for (int a = 0; a < v->head.n_attributes; a++) {
          const tc_vmd_attribute *attribute = &v->head.attributes[a];
          difference(bytes + (run.records - v->bytes) + (size_t)i * run.step + attribute->at, before + attribute->at,
                     tc_vmd_type_size(attribute->type), back);
        }
}

static bool deflate_body(GByteArray *body, GError **error) {
  uLongf size = compressBound(body->len);
  uint8_t *packed = g_try_malloc(size);
  bool good = packed && compress2(packed, &size, body->data, body->len, 9) == Z_OK;
  if (good) {
    g_byte_array_set_size(body, 0);
    put(body, packed, size);
  } else {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: no memory to compress it");
  }
  g_free(packed);
  return good;
}

GByteArray *tc_vmd_encode(const tc_vmd *v, bool compressed, GError **error) {
  if (v->total_bytes > G_MAXUINT / 2) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL,
                 "voxel model: files of more than 2 GiB are not written; leave attributes out");
    return NULL;
  }
  GByteArray *body = body_of(v), *file = NULL;
  uint64_t plain = body->len;
  const int flags = !compressed ? 0 : v->version == 1 ? DEFLATED : DEFLATED | DIFFERENCES;
  if (flags & DIFFERENCES) take_differences(v, body->data + body->len - tc_vmd_start(v, v->columns), false);
  if (!compressed || deflate_body(body, error)) {
    file = g_byte_array_new();
    put_head(file, v, flags, plain, body->len);
    put(file, body->data, body->len);
    put_u32(file, (uint32_t)crc32_z(0, file->data, file->len));
  }
  g_byte_array_unref(body);
  return file;
}

/* ---- reading ---- */

typedef struct header {
  tc_vmd_head head;
  int version, first[2], size[2];
  uint32_t columns;
  uint64_t voxels, body, stored;
  bool deflated, differences;
} header;

static bool bad(GError **error, const char *what) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "%s: the file is damaged, convert the volume again", what);
  return false;
}

static void read_text(tc_reader *r, char text[16]) {
  for (int i = 0; i < 16; i++) text[i] = (char)tc_reader_u8(r);
  bool good = text[15] == 0;
  for (int i = 0; i < 16; i++)
    good = good && (text[i] == 0 || g_ascii_isprint(text[i])) && (i == 0 || text[i - 1] || !text[i]);
  if (!good) r->failed = true;
}

static bool read_grid(tc_reader *r, tc_volume_desc *d) {
  for (int k = 0; k < 3; k++) d->spacing[k] = tc_reader_f64(r);
  for (int k = 0; k < 3; k++) d->origin[k] = tc_reader_f64(r);
  for (int k = 0; k < 9; k++) d->direction[k] = tc_reader_f64(r);
  d->slope = tc_reader_f64(r);
  d->intercept = tc_reader_f64(r);
  read_text(r, d->modality);
  read_text(r, d->unit);
  bool good = !r->failed && isfinite(d->slope) && d->slope != 0 && isfinite(d->intercept);
  for (int k = 0; k < 3; k++) good = good && isfinite(d->spacing[k]) && d->spacing[k] > 0 && isfinite(d->origin[k]);
  const double *m = d->direction;
  double det =
      m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) + m[2] * (m[3] * m[7] - m[4] * m[6]);
  for (int k = 0; k < 9; k++) good = good && fabs(m[k]) <= 1.001;
  return good && fabs(det) > 1e-6;
}

static bool read_sizes(tc_reader *r, header *h) {
  bool good = true;
  for (int k = 0; k < 3; k++) {
    uint32_t n = tc_reader_u32(r);
    good = good && n >= 1 && n <= TC_VMD_SIDE;
    h->head.grid.dims[k] = good ? (int)n : 1;
  }
  uint32_t rectangle[4];
  for (int k = 0; k < 4; k++) rectangle[k] = tc_reader_u32(r);
  for (int k = 0; k < 2; k++) {
    uint32_t n = (uint32_t)h->head.grid.dims[k];
    good = good && rectangle[k] <= n && rectangle[2 + k] <= n - rectangle[k];
    h->first[k] = good ? (int)rectangle[k] : 0;
    h->size[k] = good ? (int)rectangle[2 + k] : 0;
  }
  h->columns = tc_reader_u32(r);
  h->voxels = tc_reader_u64(r);
  h->body = tc_reader_u64(r);
  h->stored = tc_reader_u64(r);
  return good && !r->failed && h->columns <= (uint64_t)h->size[0] * (uint64_t)h->size[1];
}

static bool read_attributes(tc_reader *r, header *h, GError **error) {
  int count = tc_reader_u16(r), record = tc_reader_u16(r);
  h->head.n_palette = tc_reader_u16(r);
  if (tc_reader_u16(r) != 0 || count > TC_VMD_ATTRIBUTES || h->head.n_palette > TC_VMD_PALETTE)
    return bad(error, "more attributes or colours than a model has");
  for (int i = 0; i < count; i++) {
    char name[16];
    read_text(r, name);
    unsigned type = tc_reader_u16(r), bytes = tc_reader_u16(r);
    if (r->failed || type >= TC_VMD_TYPE_COUNT || bytes != tc_vmd_type_size((tc_vmd_type)type))
      return bad(error, "an attribute of unknown type or size");
    if (!tc_vmd_head_add(&h->head, name, (tc_vmd_type)type, NULL))
      return bad(error, "an attribute without a name of its own");
  }
  for (int i = 0; i < h->head.n_palette; i++)
    for (int c = 0; c < 4; c++) h->head.palette[i][c] = tc_reader_u8(r);
  return h->head.record_bytes == record || bad(error, "attributes and record differ in size");
}

static bool read_head(tc_reader *r, header *h, GError **error) {
  char magic[4];
  for (int i = 0; i < 4; i++) magic[i] = (char)tc_reader_u8(r);
  int version = tc_reader_u16(r), flags = tc_reader_u16(r);
  if (r->failed || memcmp(magic, "TVMD", 4) != 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "not a voxel model (.vmd begins with TVMD)");
    return false;
  }
  if (version < 1 || version > TC_VMD_VERSION || flags > (version == 1 ? DEFLATED : DEFLATED | DIFFERENCES)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL,
                 "voxel model of version %d, flags %d: this program reads up to version %d", version, flags,
                 TC_VMD_VERSION);
    return false;
  }
  h->version = version, h->deflated = flags & DEFLATED, h->differences = flags & DIFFERENCES;
  if (!read_sizes(r, h)) return bad(error, "grid sizes or column counts");
  if (!read_grid(r, &h->head.grid)) return bad(error, "place in space, modality or unit");
  h->head.grid.frames = 1;
  h->head.grid.type = TC_U8;
  strcpy(h->head.grid.format, "vmd");
  return read_attributes(r, h, error) && (!r->failed || bad(error, "the header ends early"));
}

static bool check_sums(const tc_reader *r, const header *h, GError **error) {
  uint32_t sum;
  if (r->size < r->at + 4 || h->stored != r->size - r->at - 4)
    return bad(error, "its length is not what the header says");
  memcpy(&sum, r->bytes + r->size - 4, 4);
  if (sum != (uint32_t)crc32_z(0, r->bytes, r->size - 4)) return bad(error, "checksum");
  uint64_t most = h->deflated ? h->stored * MOST_INFLATED : h->stored;
  if (h->body > most || h->body > UINT32_MAX || (!h->deflated && h->body != h->stored) ||
      (uint64_t)h->size[0] * (uint64_t)h->size[1] > h->body)
    return bad(error, "body sizes");
  return true;
}

static uint8_t *take_body(const tc_reader *r, const header *h, GError **error) {
  uint8_t *body = g_try_malloc(h->body + 1);
  uLongf size = h->body;
  uLong stored = h->stored;
  if (!body) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: no memory for %" G_GUINT64_FORMAT " bytes", h->body);
  } else if (!h->deflated) {
    memcpy(body, r->bytes + r->at, h->body);
  } else if (uncompress2(body, &size, r->bytes + r->at, &stored) != Z_OK || size != h->body || stored != h->stored) {
    bad(error, "compressed data");
    g_clear_pointer(&body, g_free);
  }
  return body;
}

/* A varint of at most five bytes in its shortest form, before `end`. */
static bool take_number(const uint8_t **at, const uint8_t *end, uint32_t *value) {
  uint64_t sum = 0;
  for (int i = 0; i < 5 && *at < end; i++) {
    uint8_t byte = *(*at)++;
    sum |= (uint64_t)(byte & 127) << 7 * i;
    if (byte >= 128) continue;
    *value = (uint32_t)sum;
    return sum <= UINT32_MAX && (byte || i == 0);
  }
  return false;
}

/* Checks that runs lie in the grid in order, in version 1 with free voxels between them, and take exactly these bytes. */
static bool check_column(const header *h, const uint8_t *at, const uint8_t *end, uint64_t *voxels) {
  const bool old = h->version == 1;
  uint64_t z = 0;
  for (bool first = true;; first = false) {
    uint32_t gap = 0, count;
    uint32_t kind = TC_VMD_EACH;
    if (old && !take_number(&at, end, &gap)) return false;
    if (!take_number(&at, end, &count)) return false;
    if (!old) kind = count & 3, count >>= 2;
    if (kind == TC_VMD_KINDS) return false;
    if (count == 0) return gap == 0 && kind == TC_VMD_EACH && !first && at == end;
    if (!old && !take_number(&at, end, &gap)) return false;
    z += (uint64_t)gap + count;
    uint64_t records = kind == TC_VMD_EACH ? count : kind == TC_VMD_SAME;
    records *= (uint64_t)h->head.record_bytes;
    if ((old && !first && gap == 0) || z > (uint64_t)h->head.grid.dims[2] || records > (uint64_t)(end - at))
      return false;
    at += records;
    *voxels += count;
  }
}

/* Reads the columns' lengths; sets where their bytes begin. */
static const uint8_t *take_lengths(const header *h, const uint8_t *body, uint32_t *lengths, GError **error) {
  const uint8_t *at = body, *end = body + h->body;
  const size_t cells = (size_t)h->size[0] * (size_t)h->size[1];
  uint64_t sum = 0;
  uint32_t columns = 0;
  for (size_t i = 0; i < cells; i++) {
    if (!take_number(&at, end, &lengths[i])) return bad(error, "column table"), NULL;
    sum += lengths[i];
    columns += lengths[i] != 0;
  }
  if (sum == (uint64_t)(end - at) && columns == h->columns) return at;
  bad(error, "column table");
  return NULL;
}

static bool check_columns(const header *h, const uint8_t *at, const uint32_t *lengths, GError **error) {
  const size_t cells = (size_t)h->size[0] * (size_t)h->size[1];
  uint64_t voxels = 0;
  for (size_t i = 0; i < cells; at += lengths[i++])
    if (lengths[i] && !check_column(h, at, at + lengths[i], &voxels))
      return bad(error, "a column with runs that overlap, leave the grid or have no end");
  return voxels == h->voxels || bad(error, "number of voxels");
}

static tc_vmd *index_body(const header *h, const uint8_t *body, GError **error) {
  uint32_t *lengths = calloc((size_t)h->size[0] * (size_t)h->size[1] + 1, sizeof *lengths);
  tc_vmd *v = NULL;
  if (!lengths) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: no memory for its columns");
    return NULL;
  }
  const uint8_t *at = take_lengths(h, body, lengths, error);
  if (at && check_columns(h, at, lengths, error)) {
    const size_t size = h->body - (size_t)(at - body);
    uint8_t *bytes = g_try_malloc(size + 1);
    if (bytes) memcpy(bytes, at, size);
    const tc_vmd_columns columns = {{h->first[0], h->first[1]}, {h->size[0], h->size[1]}, lengths, bytes};
    if (bytes) v = tc_vmd_new(h->version, &h->head, &columns, error);
    if (!bytes) tc_set_error(error, TC_ERROR_MEMORY, NULL, "voxel model: no memory for %zu bytes", size);
    if (!v) g_free(bytes);
    if (v && h->differences) take_differences(v, v->bytes, true);
  }
  free(lengths);
  return v;
}

tc_vmd *tc_vmd_decode(const uint8_t *bytes, size_t size, GError **error) {
  header h = {0};
  tc_reader r;
  tc_reader_init(&r, bytes, size, false);
  if (!read_head(&r, &h, error) || !check_sums(&r, &h, error)) return NULL;
  uint8_t *body = take_body(&r, &h, error);
  if (!body) return NULL;
  tc_vmd *v = index_body(&h, body, error);
  g_free(body);
  return v;
}
