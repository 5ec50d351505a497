#include "renderer/import/helper/decode.h"

#include <bzlib.h>
#include <isa-l/igzip_lib.h>
#include <string.h>

/* Encoded bytes are fetched in chunks large enough to hide the system call's cost. */
enum { input_chunk = 128 << 10, scratch_size = 64 << 10 };

/* Decodes from the chunk into to[n]; *made receives the number of bytes. */
typedef enum stepped { GOES_ON, STREAM_ENDS, DAMAGED } stepped;
typedef stepped (*step_fn)(tc_decoder *d, uint8_t *to, unsigned n, unsigned *made);

struct tc_decoder {
  const tc_input *input;
  uint64_t at; /* offset of the next encoded byte to fetch */
  tc_encoding encoding;
  step_fn step;   /* decoder of a compressed stream; NULL: raw */
  uint8_t *chunk; /* [input_chunk] */
  uint8_t *next;  /* next byte of the chunk to decode */
  unsigned left;
  struct inflate_state *inflate;
  bz_stream bzip;
  bool bzip_open;
  bool ended; /* the compressed stream is complete */
  bool cut;   /* the file ended before the stream */
  GByteArray *text;
  size_t text_at;
  tc_watch_fn watch; /* NULL: none */
  void *watch_user;
};

static bool read_text(tc_decoder *d, tc_element element, uint64_t wanted, GError **error) {
  uint64_t length = d->input->size > d->at ? d->input->size - d->at : 0;
  if (length > TC_TEXT_LIMIT) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "text data of more than 16 MiB: save them raw or gzip encoded");
    return false;
  }
  char *text = g_try_malloc(length + 1);
  if (!text) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory for %" G_GUINT64_FORMAT " bytes of text data", length);
    return false;
  }
  if (tc_input_read(d->input, d->at, text, length, error)) {
    text[length] = '\0';
    d->text = d->encoding == TC_ENCODING_TEXT ? tc_decode_text(text, length, element, wanted, error)
                                              : tc_decode_hex(text, length, wanted, error);
  }
  g_free(text);
  return d->text != NULL;
}

static stepped inflate_step(tc_decoder *d, uint8_t *to, unsigned n, unsigned *made) {
  struct inflate_state *z = d->inflate;
  z->next_in = d->next, z->avail_in = d->left;
  z->next_out = to, z->avail_out = n;
  const int rc = isal_inflate(z);
  d->next = z->next_in, d->left = z->avail_in;
  *made = n - z->avail_out;
  return rc != ISAL_DECOMP_OK ? DAMAGED : z->block_state == ISAL_BLOCK_FINISH ? STREAM_ENDS : GOES_ON;
}

static stepped bunzip_step(tc_decoder *d, uint8_t *to, unsigned n, unsigned *made) {
  d->bzip.next_in = (char *)d->next, d->bzip.avail_in = d->left;
  d->bzip.next_out = (char *)to, d->bzip.avail_out = n;
  const int rc = BZ2_bzDecompress(&d->bzip);
  d->next = (uint8_t *)d->bzip.next_in, d->left = d->bzip.avail_in;
  *made = n - d->bzip.avail_out;
  return rc == BZ_STREAM_END ? STREAM_ENDS : rc == BZ_OK ? GOES_ON : DAMAGED;
}

/* The first byte distinguishes gzip and zlib. */
static bool start_inflate(tc_decoder *d, GError **error) {
  uint8_t first = 0;
  if (d->at < d->input->size && !tc_input_read(d->input, d->at, &first, 1, error)) return false;
  d->step = inflate_step;
  d->inflate = g_new(struct inflate_state, 1);
  isal_inflate_init(d->inflate);
  d->inflate->crc_flag = first == 0x1f ? ISAL_GZIP : ISAL_ZLIB;
  return true;
}

static bool start_bunzip(tc_decoder *d, GError **error) {
  d->step = bunzip_step;
  d->bzip = (bz_stream){0};
  d->bzip_open = BZ2_bzDecompressInit(&d->bzip, 0, 0) == BZ_OK;
  if (!d->bzip_open) tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory to start decompression");
  return d->bzip_open;
}

tc_decoder *tc_decoder_new(const tc_input *input, uint64_t offset, tc_encoding encoding, tc_element element,
                           uint64_t wanted, GError **error) {
  tc_decoder *d = g_new0(tc_decoder, 1);
  d->input = input;
  d->at = offset;
  d->encoding = encoding;
  bool ok = true;
  switch (encoding) {
  case TC_ENCODING_RAW: break;
  case TC_ENCODING_DEFLATE: ok = start_inflate(d, error); break;
  case TC_ENCODING_BZIP2: ok = start_bunzip(d, error); break;
  case TC_ENCODING_TEXT:
  case TC_ENCODING_HEX: ok = read_text(d, element, wanted, error); break;
  case TC_ENCODING_COUNT: break;
  }
  if (d->step) d->chunk = d->next = g_malloc(input_chunk);
  if (!ok) g_clear_pointer(&d, tc_decoder_free);
  return d;
}

void tc_decoder_free(tc_decoder *d) {
  if (!d) return;
  if (d->bzip_open) BZ2_bzDecompressEnd(&d->bzip);
  if (d->text) g_byte_array_unref(d->text);
  g_free(d->inflate);
  g_free(d->chunk);
  g_free(d);
}

bool tc_decoder_cut(const tc_decoder *d) { return d->cut; }

void tc_decoder_watch(tc_decoder *d, tc_watch_fn watch, void *user) {
  d->watch = watch;
  d->watch_user = user;
}

static bool goes_on(const tc_decoder *d, GError **error) { return !d->watch || d->watch(d->watch_user, error); }

/* Fetches encoded bytes behind those left in the chunk; none at the end of the file. Concatenated empty streams
 * decode to nothing for any number of bytes, so the watch function is called here. */
static bool refill(tc_decoder *d, GError **error) {
  if (!goes_on(d, error)) return false;
  memmove(d->chunk, d->next, d->left);
  d->next = d->chunk;
  const uint64_t more = d->input->size > d->at ? d->input->size - d->at : 0;
  const unsigned n = (unsigned)MIN(more, (uint64_t)(input_chunk - d->left));
  if (!tc_input_read(d->input, d->at, d->chunk + d->left, n, error)) return false;
  d->at += n;
  d->left += n;
  return true;
}

/* A gzip or bzip2 file may hold several streams one after another (bgzip, parallel compressors, cat). Other bytes
 * behind a stream are padding and end the data. */
static bool next_stream(tc_decoder *d, GError **error) {
  const char *magic = !d->inflate ? "BZ" : d->inflate->crc_flag == ISAL_GZIP ? "\x1f\x8b" : "";
  d->ended = true;
  if (d->left < 2 && !refill(d, error)) return false;
  if (!*magic || d->left < 2 || memcmp(d->next, magic, 2) != 0) return true;
  d->ended = false;
  if (d->inflate) {
    isal_inflate_reset(d->inflate);
    return true;
  }
  BZ2_bzDecompressEnd(&d->bzip);
  return start_bunzip(d, error);
}

static bool unpack_some(tc_decoder *d, uint8_t *to, size_t n, size_t *got, GError **error) {
  size_t done = 0;
  while (done < n && !d->ended && !d->cut) {
    if (d->left == 0 && !refill(d, error)) return false;
    const unsigned before = d->left;
    unsigned made;
    const stepped step = d->step(d, to + done, (unsigned)MIN(n - done, (size_t)1 << 30), &made);
    done += made;
    if (step == DAMAGED) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "compressed data are damaged: fetch the file again");
      return false;
    }
    if (step == STREAM_ENDS && !next_stream(d, error)) return false;
    if (step == GOES_ON && made == 0 && d->left == before) d->cut = true; /* no bytes are left to decode */
  }
  *got = done;
  return true;
}

bool tc_decoder_read(tc_decoder *d, void *to, size_t n, size_t *got, GError **error) {
  *got = 0;
  switch (d->encoding) {
  case TC_ENCODING_RAW: {
    uint64_t left = d->input->size > d->at ? d->input->size - d->at : 0;
    n = (size_t)MIN((uint64_t)n, left);
    if (!tc_input_read(d->input, d->at, to, n, error)) return false;
    d->at += n;
    *got = n;
    return true;
  }
  case TC_ENCODING_DEFLATE:
  case TC_ENCODING_BZIP2: return unpack_some(d, to, n, got, error);
  case TC_ENCODING_TEXT:
  case TC_ENCODING_HEX:
    n = MIN(n, d->text->len - d->text_at);
    if (n > 0) memcpy(to, d->text->data + d->text_at, n);
    d->text_at += n;
    *got = n;
    return true;
  case TC_ENCODING_COUNT: break;
  }
  return true;
}

bool tc_decoder_skip(tc_decoder *d, uint64_t n, uint64_t *skipped, GError **error) {
  *skipped = 0;
  if (d->encoding == TC_ENCODING_RAW) {
    uint64_t left = d->input->size > d->at ? d->input->size - d->at : 0;
    *skipped = MIN(n, left);
    d->at += *skipped;
    return true;
  }
  uint8_t *scratch = g_malloc(scratch_size);
  bool ok = true;
  while (*skipped < n) {
    size_t got;
    ok = tc_decoder_read(d, scratch, (size_t)MIN(n - *skipped, (uint64_t)scratch_size), &got, error);
    if (!ok || got == 0) break;
    *skipped += got;
    if (!(ok = goes_on(d, error))) break;
  }
  g_free(scratch);
  return ok;
}
