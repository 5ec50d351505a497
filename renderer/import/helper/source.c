/* Sources: the parts of an image's data as one stream. */
#include "renderer/import/helper/source.h"

#include <string.h>

#include "renderer/import/helper/decode.h"
#include "renderer/import/reader.h"

/* Deflate's largest ratio is 1032:1; the margin is for headers of tiny files. */
#define DEFLATE_RATIO 1100u
/* The end of a compressed stream is searched this far behind the data. */
#define TRAILER_REACH (1u << 20)
/* Largest number of decoded bytes before the voxels. A stream whose data are "the last bytes" is decoded twice. */
#define LEAD_LIMIT (256u << 20)
/* Decoded bytes of unread frames, to check that they are complete. */
#define UNREAD_REACH (64u << 20)
#define LINE_SKIP_REACH (64u << 20)

size_t tc_element_size(tc_element element) {
  static const uint8_t sizes[TC_ELEMENT_COUNT] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
  return sizes[element];
}

const char *tc_element_name(tc_element element) {
  static const char names[TC_ELEMENT_COUNT][4] = {"i8", "u8", "i16", "u16", "i32", "u32", "i64", "u64", "f32", "f64"};
  return names[element];
}

void tc_data_clear(tc_data *data) {
  if (data->names) g_ptr_array_unref(data->names);
  *data = (tc_data){0};
}

bool tc_data_attach(tc_data *data, uint64_t at, GError **error) {
  const tc_encoding packing = data->input->packing;
  data->offset = packing == TC_ENCODING_RAW ? at : 0;
  if (packing == TC_ENCODING_RAW) return true;
  if (data->encoding != TC_ENCODING_RAW || data->line_skip || __builtin_add_overflow(data->byte_skip, (int64_t)at, &data->byte_skip)) {
    tc_set_error(error, TC_ERROR_UNSUPPORTED, NULL, "encoded voxels in a packed file are not read: unpack the file first");
    return false;
  }
  if (data->byte_skip < (int64_t)at) data->byte_skip = -1; /* the data are still the last bytes of the stream */
  data->encoding = packing;
  return true;
}

uint64_t tc_data_parts(const tc_data *data) { return data->names ? data->names->len : 1; }

/* Opens the file of a part. A part in the header's own file borrows the input: fd -1 and bytes NULL mark that nothing
 * is to be closed. */
static bool open_part(const tc_data *data, uint64_t index, tc_input *own, const tc_input **input, GError **error) {
  *own = (tc_input){.fd = -1};
  *input = data->input;
  if (!data->names) return true;
  *input = own;
  return tc_input_open_sibling(data->input, g_ptr_array_index(data->names, index), false, own, error);
}

static void name_part(const tc_data *data, uint64_t index, GError **error) {
  if (!data->names || !error || !*error || strstr((*error)->message, "data file ")) return;
  char *quoted = tc_text_quote(g_ptr_array_index(data->names, index));
  g_prefix_error(error, "data file %s: ", quoted);
  g_free(quoted);
}

/* Offset of the encoded bytes behind line_skip lines. */
static bool skip_lines(const tc_data *data, const tc_input *input, uint64_t *at, GError **error) {
  uint8_t bytes[4096];
  *at = data->offset;
  for (uint64_t lines = data->line_skip; lines > 0;) {
    size_t n = *at < input->size ? (size_t)MIN(input->size - *at, (uint64_t)sizeof bytes) : 0;
    if (n == 0 || *at - data->offset > LINE_SKIP_REACH) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "line skip: the file has fewer lines");
      return false;
    }
    if (!tc_input_read(input, *at, bytes, n, error)) return false;
    size_t used = 0;
    while (used < n && lines > 0)
      if (bytes[used++] == '\n') lines--;
    *at += used;
  }
  return true;
}

static void say_short(GError **error, uint64_t has, uint64_t wants) {
  tc_set_error(error, TC_ERROR_FORMAT, NULL,
               "voxels are cut short: %" G_GUINT64_FORMAT " of %" G_GUINT64_FORMAT " bytes are there", has, wants);
}

static tc_decoder *new_decoder(const tc_data *data, const tc_input *input, uint64_t at, uint64_t wanted,
                               GError **error) {
  tc_decoder *decoder = tc_decoder_new(input, at, data->encoding, data->element, wanted, error);
  if (decoder) tc_decoder_watch(decoder, data->watch, data->watch_user);
  return decoder;
}

static void say_lead(GError **error) {
  tc_set_error(error, TC_ERROR_LIMIT, NULL, "byte skip: more than 256 MiB lie before the voxels");
}

/* Decodes the stream to count its bytes, up to `enough`. */
static bool count_bytes(const tc_data *data, const tc_input *input, uint64_t at, uint64_t enough, uint64_t *count,
                        GError **error) {
  tc_decoder *decoder = new_decoder(data, input, at, 0, error);
  bool ok = decoder && tc_decoder_skip(decoder, enough, count, error);
  tc_decoder_free(decoder);
  return ok;
}

static bool check_part(const tc_data *data, const tc_input *input, GError **error) {
  uint64_t at, lead = data->byte_skip > 0 ? (uint64_t)data->byte_skip : 0, wants;
  if (__builtin_add_overflow(lead, data->part_bytes, &wants)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "byte skip: larger than any file");
    return false;
  }
  if (data->encoding != TC_ENCODING_RAW && lead > LEAD_LIMIT) {
    say_lead(error);
    return false;
  }
  if (!skip_lines(data, input, &at, error)) return false;
  uint64_t left = input->size > at ? input->size - at : 0;
  size_t element = tc_element_size(data->element);
  switch (data->encoding) {
  case TC_ENCODING_RAW:
    if (left >= wants) return true;
    say_short(error, left > lead ? left - lead : 0, data->part_bytes);
    return false;
  case TC_ENCODING_DEFLATE:
    if (wants / DEFLATE_RATIO <= left) return true;
    tc_set_error(error, TC_ERROR_FORMAT, NULL,
                 "%" G_GUINT64_FORMAT " compressed bytes cannot hold the %" G_GUINT64_FORMAT " bytes announced", left,
                 data->part_bytes);
    return false;
  case TC_ENCODING_BZIP2: return true;
  case TC_ENCODING_TEXT:
    if (data->part_bytes / element <= (left + 1) / 2) return true; /* each number takes at least a digit and a separator */
    say_short(error, left, data->part_bytes / element * 2);
    return false;
  case TC_ENCODING_HEX:
    if (data->part_bytes <= left / 2) return true;
    say_short(error, left / 2, data->part_bytes);
    return false;
  case TC_ENCODING_COUNT: break;
  }
  return false;
}

bool tc_data_check(const tc_data *data, GError **error) {
  bool ok = true;
  for (uint64_t i = 0; ok && i < tc_data_parts(data); i++) {
    tc_input own;
    const tc_input *input;
    ok = open_part(data, i, &own, &input, error) && check_part(data, input, error);
    tc_input_close(&own);
    if (!ok) name_part(data, i, error);
  }
  return ok;
}

struct tc_source {
  const tc_data *data;
  uint64_t part; /* next part to open; the open part is part - 1 */
  tc_input own;
  const tc_input *input;
  tc_decoder *decoder; /* of the open part, or NULL */
  uint64_t left;       /* remaining decoded bytes of the part */
  uint64_t lead;       /* decoded bytes before the voxels of the part */
};

tc_source *tc_source_new(const tc_data *data) {
  tc_source *source = g_new0(tc_source, 1);
  source->data = data;
  source->own = (tc_input){.fd = -1};
  return source;
}

static void close_part(tc_source *source) {
  tc_decoder_free(source->decoder);
  source->decoder = NULL;
  tc_input_close(&source->own);
}

void tc_source_free(tc_source *source) {
  if (!source) return;
  close_part(source);
  g_free(source);
}

/* Number of decoded bytes before the voxels. */
static bool lead_bytes(const tc_source *source, uint64_t at, uint64_t *lead, GError **error) {
  const tc_data *data = source->data;
  *lead = (uint64_t)MAX(data->byte_skip, 0);
  if (data->byte_skip >= 0) return true;
  uint64_t total = source->input->size > at ? source->input->size - at : 0;
  if (data->encoding != TC_ENCODING_RAW) {
    uint64_t reach = data->part_bytes > UINT64_MAX - LEAD_LIMIT ? UINT64_MAX : data->part_bytes + LEAD_LIMIT;
    if (!count_bytes(data, source->input, at, reach, &total, error)) return false;
    if (total == reach) {
      say_lead(error);
      return false;
    }
  }
  if (total < data->part_bytes) {
    say_short(error, total, data->part_bytes);
    return false;
  }
  *lead = total - data->part_bytes;
  return true;
}

static bool open_next(tc_source *source, GError **error) {
  const tc_data *data = source->data;
  close_part(source);
  if (source->part >= tc_data_parts(data)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "voxels are cut short");
    return false;
  }
  uint64_t at, lead, skipped;
  uint64_t index = source->part++;
  if (!open_part(data, index, &source->own, &source->input, error)) return false;
  if (!skip_lines(data, source->input, &at, error) || !lead_bytes(source, at, &lead, error)) return false;
  source->decoder = new_decoder(data, source->input, at, data->part_bytes + lead, error);
  if (!source->decoder || !tc_decoder_skip(source->decoder, lead, &skipped, error)) return false;
  if (skipped < lead) {
    say_short(error, 0, data->part_bytes);
    return false;
  }
  source->left = data->part_bytes;
  source->lead = lead;
  return true;
}

/* Reads into `to`, or skips bytes if it is NULL. */
static bool advance(tc_source *source, uint8_t *to, uint64_t n, GError **error) {
  while (n > 0) {
    if (!source->decoder || source->left == 0)
      if (!open_next(source, error)) goto fail;
    uint64_t want = MIN(n, source->left), moved = 0;
    size_t got = 0;
    bool ok = to ? tc_decoder_read(source->decoder, to, (size_t)want, &got, error)
                 : tc_decoder_skip(source->decoder, want, &moved, error);
    if (!ok) goto fail;
    if (to) moved = got;
    if (moved == 0) {
      say_short(error, source->data->part_bytes - source->left, source->data->part_bytes);
      goto fail;
    }
    source->left -= moved;
    n -= moved;
    if (to) to += moved;
  }
  return true;
fail:
  if (source->part > 0) name_part(source->data, source->part - 1, error);
  return false;
}

bool tc_source_read(tc_source *source, void *to, size_t n, GError **error) { return advance(source, to, n, error); }

bool tc_source_skip(tc_source *source, uint64_t n, GError **error) { return advance(source, NULL, n, error); }

/* A gzip file ends with its decoded size: if that is the expected size, the file is complete. */
static bool ends_with_size(const tc_source *source) {
  const tc_input *input = source->input;
  uint32_t wanted = (uint32_t)(source->lead + source->data->part_bytes);
  uint8_t tail[4];
  if (input->size < 18 || !tc_input_read(input, input->size - 4, tail, sizeof tail, NULL)) return false;
  tc_reader r;
  tc_reader_init(&r, tail, sizeof tail, false);
  return tc_reader_u32(&r) == wanted;
}

bool tc_source_finish(tc_source *source, GError **error) {
  tc_encoding encoding = source->data->encoding;
  if (!source->decoder || (encoding != TC_ENCODING_DEFLATE && encoding != TC_ENCODING_BZIP2)) return true;
  if (source->left > 0) {
    if (encoding == TC_ENCODING_DEFLATE && ends_with_size(source)) return true;
    const bool all = source->left <= UNREAD_REACH;
    if (!tc_source_skip(source, MIN(source->left, (uint64_t)UNREAD_REACH), error)) return false;
    if (!all) return true;
  }
  uint64_t behind;
  if (!tc_decoder_skip(source->decoder, TRAILER_REACH, &behind, error)) return false;
  if (tc_decoder_cut(source->decoder)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "compressed data end before their check sum: fetch the file again");
    return false;
  }
  return true;
}
