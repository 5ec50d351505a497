#include "renderer/import/helper/decode.h"

#include <bzlib.h>
#include <string.h>
#include <zlib.h>

/* Encoded bytes are fetched this many at a time: large enough to hide the system call, small beside any volume. */
enum { input_chunk = 128 << 10, scratch_size = 64 << 10 };

struct tc_decoder {
  const tc_input *input;
  uint64_t at; /* next encoded byte to fetch */
  tc_encoding encoding;
  uint8_t *chunk; /* [input_chunk] */
  z_stream zip;
  bz_stream bzip;
  bool zip_open, bzip_open, gzip;
  bool ended; /* the compressed stream said it is complete */
  bool cut;   /* the file ended before that */
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

tc_decoder *tc_decoder_new(const tc_input *input, uint64_t offset, tc_encoding encoding, tc_element element,
                           uint64_t wanted, GError **error) {
  tc_decoder *d = g_new0(tc_decoder, 1);
  d->input = input;
  d->at = offset;
  d->encoding = encoding;
  bool ok = true;
  switch (encoding) {
  case TC_ENCODING_RAW: break;
  case TC_ENCODING_DEFLATE:
    /* 32: zlib tells gzip and zlib apart by their first bytes */
    ok = d->zip_open = inflateInit2(&d->zip, MAX_WBITS + 32) == Z_OK;
    break;
  case TC_ENCODING_BZIP2: ok = d->bzip_open = BZ2_bzDecompressInit(&d->bzip, 0, 0) == BZ_OK; break;
  case TC_ENCODING_TEXT:
  case TC_ENCODING_HEX:
    if (!read_text(d, element, wanted, error)) goto fail;
    break;
  case TC_ENCODING_COUNT: break;
  }
  if (!ok) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory to start decompression");
    goto fail;
  }
  if (d->zip_open || d->bzip_open) d->chunk = g_malloc(input_chunk);
  return d;
fail:
  tc_decoder_free(d);
  return NULL;
}

void tc_decoder_free(tc_decoder *d) {
  if (!d) return;
  if (d->zip_open) inflateEnd(&d->zip);
  if (d->bzip_open) BZ2_bzDecompressEnd(&d->bzip);
  if (d->text) g_byte_array_unref(d->text);
  g_free(d->chunk);
  g_free(d);
}

bool tc_decoder_cut(const tc_decoder *d) { return d->cut; }

void tc_decoder_watch(tc_decoder *d, tc_watch_fn watch, void *user) {
  d->watch = watch;
  d->watch_user = user;
}

static bool goes_on(const tc_decoder *d, GError **error) { return !d->watch || d->watch(d->watch_user, error); }

/* The next encoded bytes into chunk; *n is 0 at the end of the file. Empty streams behind each other decode to nothing
 * for as long as there are bytes, so this asks whether to go on. */
static bool fetch(tc_decoder *d, unsigned *n, GError **error) {
  if (!goes_on(d, error)) return false;
  uint64_t left = d->input->size > d->at ? d->input->size - d->at : 0;
  *n = (unsigned)MIN(left, (uint64_t)input_chunk);
  if (!tc_input_read(d->input, d->at, d->chunk, *n, error)) return false;
  d->at += *n;
  return true;
}

static bool zip_refill(tc_decoder *d, GError **error) {
  unsigned n;
  if (!fetch(d, &n, error)) return false;
  d->zip.next_in = d->chunk;
  d->zip.avail_in = n;
  return true;
}

/* A gzip file may be several members after each other (bgzip, parallel compressors, cat). Anything else behind a
 * member is padding and ends the data. */
static bool next_member(tc_decoder *d, GError **error) {
  d->ended = true;
  if (!d->gzip) return true;
  if (d->zip.avail_in < 2) {
    if (d->zip.avail_in == 1) { /* keep the odd byte: step back in the file */
      d->at--;
      d->zip.avail_in = 0;
    }
    if (!zip_refill(d, error)) return false;
  }
  if (d->zip.avail_in >= 2 && d->zip.next_in[0] == 0x1f && d->zip.next_in[1] == 0x8b) {
    d->ended = false;
    inflateReset(&d->zip);
  }
  return true;
}

static bool inflate_some(tc_decoder *d, uint8_t *to, size_t n, size_t *got, GError **error) {
  size_t done = 0;
  while (done < n && !d->ended && !d->cut) {
    if (d->zip.avail_in == 0) {
      bool first = d->zip.total_in == 0 && !d->gzip;
      if (!zip_refill(d, error)) return false;
      if (d->zip.avail_in == 0) {
        d->cut = true;
        break;
      }
      if (first) d->gzip = d->zip.next_in[0] == 0x1f;
    }
    unsigned room = (unsigned)MIN(n - done, (size_t)1 << 30);
    d->zip.next_out = to + done;
    d->zip.avail_out = room;
    int rc = inflate(&d->zip, Z_NO_FLUSH);
    done += room - d->zip.avail_out;
    if (rc == Z_STREAM_END) {
      if (!next_member(d, error)) return false;
    } else if (rc != Z_OK && rc != Z_BUF_ERROR) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "compressed data are damaged (%s): fetch the file again",
                   rc == Z_NEED_DICT ? "dictionary wanted" : d->zip.msg ? d->zip.msg : "inflate failed");
      return false;
    }
  }
  *got = done;
  return true;
}

static bool bunzip_refill(tc_decoder *d, GError **error) {
  unsigned n;
  if (!fetch(d, &n, error)) return false;
  d->bzip.next_in = (char *)d->chunk;
  d->bzip.avail_in = n;
  return true;
}

/* As with gzip, parallel compressors write several streams after each other. */
static bool next_stream(tc_decoder *d, GError **error) {
  d->ended = true;
  if (d->bzip.avail_in == 0 && !bunzip_refill(d, error)) return false;
  if (d->bzip.avail_in == 0 || *d->bzip.next_in != 'B') return true;
  bz_stream rest = d->bzip;
  BZ2_bzDecompressEnd(&d->bzip);
  d->bzip = (bz_stream){.next_in = rest.next_in, .avail_in = rest.avail_in};
  d->bzip_open = BZ2_bzDecompressInit(&d->bzip, 0, 0) == BZ_OK;
  d->ended = !d->bzip_open;
  return true;
}

static bool bunzip_some(tc_decoder *d, uint8_t *to, size_t n, size_t *got, GError **error) {
  size_t done = 0;
  while (done < n && !d->ended && !d->cut) {
    if (d->bzip.avail_in == 0) {
      if (!bunzip_refill(d, error)) return false;
      if (d->bzip.avail_in == 0) {
        d->cut = true;
        break;
      }
    }
    unsigned room = (unsigned)MIN(n - done, (size_t)1 << 30);
    d->bzip.next_out = (char *)to + done;
    d->bzip.avail_out = room;
    int rc = BZ2_bzDecompress(&d->bzip);
    done += room - d->bzip.avail_out;
    if (rc == BZ_STREAM_END) {
      if (!next_stream(d, error)) return false;
    } else if (rc != BZ_OK) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "bzip2 data are damaged: fetch the file again");
      return false;
    }
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
  case TC_ENCODING_DEFLATE: return inflate_some(d, to, n, got, error);
  case TC_ENCODING_BZIP2: return bunzip_some(d, to, n, got, error);
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
