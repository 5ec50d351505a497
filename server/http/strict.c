#include "server/http/strict.h"

#include <string.h>

#define CHUNK_LINE_BYTES 1024   /* limit on a chunk size line or a trailer */
#define CHUNK_EXTRA_BYTES 16384 /* limit on extensions and trailers of one body, as RFC 9112, section 7.1.1 demands */
#define EMPTY_LINES 4 /* before a request line (RFC 9112, section 2.2) */

typedef enum stage { HEAD, DATA, CHUNK_SIZE, CHUNK_END, TRAILER, HELD, REFUSED } stage;

struct tcs_strict {
  GByteArray *in, *out;
  guint out_taken;
  stage stage;
  uint64_t left; /* in DATA: of the body or chunk */
  bool chunked;
  guint seen; /* bytes of `in` searched for the end of a line or head */
  size_t extra;
  int empty_lines;
  unsigned heads;
  const tcs_refusal *refusal;
};

tcs_strict *tcs_strict_new(void) {
  tcs_strict *s = g_new0(tcs_strict, 1);
  s->in = g_byte_array_new();
  s->out = g_byte_array_new();
  return s;
}

void tcs_strict_free(tcs_strict *s) {
  if (!s) return;
  g_byte_array_unref(s->in);
  g_byte_array_unref(s->out);
  g_free(s);
}

unsigned tcs_strict_heads(const tcs_strict *s) { return s->heads; }
const tcs_refusal *tcs_strict_refusal(const tcs_strict *s) { return s->refusal; }
const GByteArray *tcs_strict_held(const tcs_strict *s) { return s->in; }
bool tcs_strict_hungry(const tcs_strict *s) { return s->stage != HELD && s->stage != REFUSED; }

void tcs_strict_give(tcs_strict *s, const uint8_t *bytes, size_t size) {
  g_byte_array_append(s->in, bytes, (guint)size);
}

static void say(tcs_strict *s, const char *text) {
  g_byte_array_append(s->out, (const guint8 *)text, (guint)strlen(text));
}

static void drop(tcs_strict *s, guint size) {
  g_byte_array_remove_range(s->in, 0, size);
  s->seen = 0;
}

/* Control characters other than line ends and tabs. */
static bool is_control(guint8 c) { return (c < 32 && c != '\t' && c != '\r' && c != '\n') || c == 127; }

/* `rest` completes what the library is reading. */
static bool refuse(tcs_strict *s, const tcs_refusal *refusal, const char *rest) {
  s->refusal = refusal;
  s->stage = REFUSED;
  g_byte_array_set_size(s->in, 0);
  say(s, rest);
  return true;
}

/* --- heads ------------------------------------------------------------------------------------------ */

static bool refuse_head(tcs_strict *s, const tcs_refusal *refusal) {
  s->heads++;
  return refuse(s, refusal, "GET /refused HTTP/1.1\r\nHost: refused\r\nConnection: close\r\n\r\n");
}

/* The size of the complete head at the start of `in`; 0: incomplete, or *refusal is set for an invalid byte. */
static guint find_head(tcs_strict *s, const tcs_refusal **refusal) {
  static const tcs_refusal line_end = {400, "request", "Bad request", "a line does not end with CR LF"},
                           control = {400, "request", "Bad request", "the head holds a control character"},
                           long_line = {414, "limit", "Too long", "the request line is over the limit"},
                           long_head = {431, "limit", "Too large", "the head is over the limit"};
  const guint8 *bytes = s->in->data;
  for (; s->seen < s->in->len; s->seen++) {
    const guint i = s->seen;
    const bool after_cr = i > 0 && bytes[i - 1] == '\r';
    if (after_cr != (bytes[i] == '\n'))
      *refusal = &line_end;
    else if (i >= TCS_HEAD_BYTES)
      *refusal = memchr(bytes, '\n', i) ? &long_head : &long_line;
    else if (is_control(bytes[i]))
      *refusal = &control;
    if (*refusal) return 0;
    if (bytes[i] == '\n' && i >= 3 && bytes[i - 2] == '\n') return i + 1;
  }
  return 0;
}

static bool read_head(tcs_strict *s) {
  const tcs_refusal *refusal = NULL;
  tcs_head head;
  while (s->in->len >= 2 && memcmp(s->in->data, "\r\n", 2) == 0 && s->empty_lines < EMPTY_LINES) {
    drop(s, 2);
    s->empty_lines++;
  }
  const guint size = find_head(s, &refusal);
  if (!size && !refusal) return false;
  if (!refusal) refusal = tcs_head_read(s->in->data, size, &head, s->out);
  if (refusal) return refuse_head(s, refusal);
  drop(s, size);
  s->heads++;
  s->empty_lines = 0;
  s->extra = 0;
  s->chunked = head.chunked;
  s->left = head.length;
  s->stage = head.chunked ? CHUNK_SIZE : head.length ? DATA : head.upgrade ? HELD : HEAD;
  return true;
}

/* --- chunks (RFC 9112, section 7.1) ------------------------------------------------------------------- */

static const tcs_refusal bad_chunk = {400, "chunk", "Bad request", "the chunked body is not well formed"};
static const tcs_refusal long_chunk = {400, "chunk", "Bad request",
                                       "the chunked body has a chunk that is too large, or too much beside its data"};

/* The length of the line at the start of `in`, without its CRLF; -1: incomplete; -2: invalid. */
static int find_line(tcs_strict *s) {
  for (; s->seen < s->in->len; s->seen++) {
    const guint8 c = s->in->data[s->seen];
    const bool after_cr = s->seen > 0 && s->in->data[s->seen - 1] == '\r';
    if (after_cr != (c == '\n') || is_control(c)) return -2;
    if (s->seen >= CHUNK_LINE_BYTES) return -2;
    if (c == '\n') return (int)s->seen - 1;
  }
  return -1;
}

static bool read_chunk_size(tcs_strict *s) {
  const int size = find_line(s);
  const char *line = (const char *)s->in->data;
  uint64_t value = 0;
  int digits = 0, at;
  if (size == -1) return false;
  for (; digits < size && g_ascii_isxdigit(line[digits]); digits++) {
    if (value >> 58) return refuse(s, &long_chunk, "0\r\n\r\n");
    value = value * 16 + (uint64_t)g_ascii_xdigit_value(line[digits]);
  }
  for (at = digits; at < size && (line[at] == ' ' || line[at] == '\t');) at++;
  if (digits == 0 || (digits < size && (at == size || line[at] != ';'))) return refuse(s, &bad_chunk, "0\r\n\r\n");
  if ((s->extra += (size_t)(size - at)) > CHUNK_EXTRA_BYTES) return refuse(s, &long_chunk, "0\r\n\r\n");
  char plain[24];
  g_snprintf(plain, sizeof plain, "%" G_GINT64_MODIFIER "x\r\n", value);
  drop(s, (guint)size + 2);
  s->left = value;
  s->stage = value ? DATA : TRAILER;
  /* The last chunk is passed on after the trailers, since the body is not complete before. */
  if (value) say(s, plain);
  return true;
}

static bool read_chunk_end(tcs_strict *s) {
  if (s->in->len < 2 && (s->in->len == 0 || s->in->data[0] == '\r')) return false;
  if (s->in->len < 2 || memcmp(s->in->data, "\r\n", 2) != 0) return refuse(s, &bad_chunk, "\r\n0\r\n\r\n");
  drop(s, 2);
  say(s, "\r\n");
  s->stage = CHUNK_SIZE;
  return true;
}

static bool read_trailer(tcs_strict *s) {
  const int size = find_line(s);
  tcs_field field;
  if (size == -1) return false;
  if (size < 0 || (size > 0 && tcs_field_read((const char *)s->in->data, (size_t)size, &field)))
    return refuse(s, &bad_chunk, "0\r\n\r\n");
  if ((s->extra += (size_t)size) > CHUNK_EXTRA_BYTES) return refuse(s, &long_chunk, "0\r\n\r\n");
  drop(s, (guint)size + 2);
  if (size > 0) return true;
  say(s, "0\r\n\r\n");
  s->stage = HEAD;
  return true;
}

/* --- the flow ---------------------------------------------------------------------------------------- */

void tcs_strict_passed(tcs_strict *s, size_t size) {
  s->left -= size;
  if (s->left == 0) s->stage = s->chunked ? CHUNK_END : HEAD;
}

static bool step(tcs_strict *s) {
  switch (s->stage) {
  case HEAD: return read_head(s);
  case CHUNK_SIZE: return read_chunk_size(s);
  case CHUNK_END: return read_chunk_end(s);
  case TRAILER: return read_trailer(s);
  case DATA:
  case HELD:
  case REFUSED: break;
  }
  return false;
}

static size_t take_out(tcs_strict *s, uint8_t *bytes, size_t room) {
  const guint count = (guint)MIN(room, s->out->len - s->out_taken);
  memcpy(bytes, s->out->data + s->out_taken, count);
  s->out_taken += count;
  if (s->out_taken == s->out->len) s->out_taken = 0, g_byte_array_set_size(s->out, 0);
  return count;
}

static size_t take_data(tcs_strict *s, uint8_t *bytes, size_t room) {
  const guint count = (guint)MIN(MIN((uint64_t)room, s->left), s->in->len);
  memcpy(bytes, s->in->data, count);
  drop(s, count);
  tcs_strict_passed(s, count);
  return count;
}

size_t tcs_strict_take(tcs_strict *s, uint8_t *bytes, size_t room) {
  size_t taken = 0;
  while (taken < room) {
    if (s->out->len)
      taken += take_out(s, bytes + taken, room - taken);
    else if (s->stage == DATA && s->in->len)
      taken += take_data(s, bytes + taken, room - taken);
    else if (!step(s))
      break;
  }
  return taken;
}

size_t tcs_strict_direct(const tcs_strict *s, size_t room) {
  if (s->stage != DATA || s->in->len || s->out->len) return 0;
  return (size_t)MIN((uint64_t)room, s->left);
}
