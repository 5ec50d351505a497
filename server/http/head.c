#include "server/http/head.h"

#include <string.h>

#include "server/ws/handshake.h"

#define REFUSE(status, code, title, detail)                                                                            \
  do {                                                                                                                 \
    static const tcs_refusal refusal = {(status), code, title, detail};                                                \
    return &refusal;                                                                                                   \
  } while (0)
#define BAD(detail) REFUSE(400, "request", "Bad request", detail)

typedef struct slice {
  const char *at;
  size_t size;
} slice;

/* List-valued fields: several lines are joined (RFC 9110, section 5.3), so that a lookup finds all elements. */
enum { LIST_COUNT = 4 };
static const char *const LISTS[LIST_COUNT] = {"Connection", "If-Match", "If-None-Match", "Sec-WebSocket-Protocol"};

/* State of the fields read so far. */
typedef struct reader {
  bool http10;     /* HTTP/1.0: no Upgrade, Expect or chunks */
  slice authority; /* of an absolute target: overrides the Host field */
  slice upgrade;   /* of an Upgrade field that asks for a WebSocket */
  bool host, length, coding, expects;
  GString *lists[LIST_COUNT];
  unsigned once; /* bit i: ONCE[i] was seen */
  int fields;
  tcs_head head;
  GByteArray *plain;
} reader;

static bool is_token(char c) { return g_ascii_isalnum(c) || (c && strchr("!#$%&'*+-.^_`|~", c)); }

static bool same(slice text, const char *word) {
  return text.size == strlen(word) && g_ascii_strncasecmp(text.at, word, text.size) == 0;
}

static void put(GByteArray *plain, const void *bytes, size_t size) { g_byte_array_append(plain, bytes, (guint)size); }
static void put_text(GByteArray *plain, const char *text) { put(plain, text, strlen(text)); }

static void put_field(GByteArray *plain, const char *name, size_t name_size, slice value) {
  put(plain, name, name_size);
  put_text(plain, ": ");
  put(plain, value.at, value.size);
  put_text(plain, "\r\n");
}

/* --- the target (RFC 9112, section 3.2) -------------------------------------------------------------- */

static bool digits_only(slice text) {
  for (size_t i = 0; i < text.size; i++)
    if (!g_ascii_isdigit(text.at[i])) return false;
  return true;
}

/* uri-host [":" port] of RFC 3986; may be empty for a target without an authority. */
static bool is_host(slice text) {
  size_t at = 0;
  if (text.size && text.at[0] == '[') {
    for (at = 1; at < text.size && (g_ascii_isxdigit(text.at[at]) || text.at[at] == ':' || text.at[at] == '.');) at++;
    if (at < 3 || at >= text.size || text.at[at++] != ']') return false;
  } else {
    while (at < text.size && (g_ascii_isalnum(text.at[at]) || (text.at[at] && strchr("-._~!$&'()*+,;=%", text.at[at]))))
      at++;
  }
  if (at == text.size) return true;
  return text.at[at] == ':' && text.size - at <= 6 && digits_only((slice){text.at + at + 1, text.size - at - 1});
}

/* Characters that RFC 3986 allows unescaped in a path or query. */
static bool is_plain(char c, bool query) {
  return g_ascii_isalnum(c) || (c && strchr("-._~!$&'()*+,;=:@/", c)) || (query && c == '?');
}

/* Checks a path or query after percent-decoding: UTF-8 text, no control characters, no encoded separators. */
static const tcs_refusal *check_part(slice part, bool query) {
  char decoded[TCS_LINE_BYTES];
  size_t size = 0;
  for (size_t i = 0; i < part.size; i++) {
    char c = part.at[i];
    if (c == '%') {
      if (part.size - i < 3 || !g_ascii_isxdigit(part.at[i + 1]) || !g_ascii_isxdigit(part.at[i + 2]))
        BAD("the target holds a percent sign without two hexadecimal digits");
      c = (char)(g_ascii_xdigit_value(part.at[i + 1]) * 16 + g_ascii_xdigit_value(part.at[i + 2]));
      if (g_ascii_iscntrl(c) || c == 0) BAD("the target holds a control character");
      if (c == '/' && !query) BAD("the path holds a slash in percent form");
      i += 2;
    } else if (!is_plain(c, query)) {
      BAD("the target holds a character that must be sent in percent form");
    }
    decoded[size++] = c;
  }
  if (!g_utf8_validate(decoded, (gssize)size, NULL)) BAD("the target is not UTF-8");
  return NULL;
}

static const tcs_refusal *put_path(slice text, GByteArray *plain) {
  const char *mark = memchr(text.at, '?', text.size);
  const slice path = {text.at, mark ? (size_t)(mark - text.at) : text.size};
  const tcs_refusal *refusal = check_part(path, false);
  if (!refusal && mark) {
    const slice query = {mark + 1, text.size - path.size - 1};
    int parts = 1;
    for (size_t i = 0; i < query.size; i++) parts += query.at[i] == '&';
    if (parts > TCS_QUERY_PARTS) REFUSE(414, "limit", "Too long", "the query has too many parts");
    refusal = check_part(query, true);
  }
  if (refusal) return refusal;
  if (path.size == 0) put_text(plain, "/");
  put(plain, text.at, text.size);
  return NULL;
}

static const tcs_refusal *put_target(reader *r, slice target, bool options) {
  static const char scheme[] = "http://";
  if (target.size && target.at[0] == '/') return put_path(target, r->plain);
  if (same(target, "*")) {
    if (!options) BAD("the target * is for OPTIONS only");
    put_text(r->plain, "*");
    return NULL;
  }
  if (target.size <= strlen(scheme) || !same((slice){target.at, strlen(scheme)}, scheme))
    BAD("the target must be a path, or a whole http:// address");
  const slice rest = {target.at + strlen(scheme), target.size - strlen(scheme)};
  size_t end = 0;
  while (end < rest.size && rest.at[end] != '/' && rest.at[end] != '?') end++;
  r->authority = (slice){rest.at, end};
  if (end == 0 || rest.at[0] == ':' || !is_host(r->authority)) BAD("the address in the request line has no valid host");
  return put_path((slice){rest.at + end, rest.size - end}, r->plain);
}

/* --- the request line (RFC 9112, section 3) ---------------------------------------------------------- */

static const tcs_refusal *check_method(slice method) {
  static const char *const known[] = {"GET", "HEAD", "POST", "PUT", "PATCH", "DELETE", "OPTIONS", "TRACE"};
  if (method.size == 0) BAD("the request line has no method");
  for (size_t i = 0; i < method.size; i++)
    if (!is_token(method.at[i])) BAD("the method is not a word");
  for (size_t i = 0; i < G_N_ELEMENTS(known); i++)
    if (method.size == strlen(known[i]) && memcmp(method.at, known[i], method.size) == 0) return NULL;
  REFUSE(501, "method", "Not implemented", "unknown method; methods are written in capitals");
}

static const tcs_refusal *check_version(reader *r, slice version) {
  if (version.size != 8 || memcmp(version.at, "HTTP/", 5) != 0 || !g_ascii_isdigit(version.at[5]) ||
      version.at[6] != '.' || !g_ascii_isdigit(version.at[7]))
    BAD("the request line must be: method, space, target, space, HTTP/1.1");
  if (version.at[5] != '1') REFUSE(505, "version", "Version not supported", "only HTTP/1.0 and HTTP/1.1 are supported");
  r->http10 = version.at[7] == '0';
  return NULL;
}

static const tcs_refusal *read_request_line(reader *r, slice line) {
  const char *first = memchr(line.at, ' ', line.size);
  const char *last = first ? memrchr(line.at, ' ', line.size) : NULL;
  if (!first || first == last) BAD("the request line must be: method, space, target, space, HTTP/1.1");
  if (line.size > TCS_LINE_BYTES) REFUSE(414, "limit", "Too long", "the request line is over the limit");
  const slice method = {line.at, (size_t)(first - line.at)};
  const slice target = {first + 1, (size_t)(last - first) - 1};
  const slice version = {last + 1, line.size - (size_t)(last + 1 - line.at)};
  const tcs_refusal *refusal;
  if ((refusal = check_version(r, version)) || (refusal = check_method(method))) return refusal;
  put(r->plain, method.at, method.size);
  put_text(r->plain, " ");
  if ((refusal = put_target(r, target, same(method, "OPTIONS")))) return refusal;
  put_text(r->plain, r->http10 ? " HTTP/1.0\r\n" : " HTTP/1.1\r\n");
  if (r->authority.size) put_field(r->plain, "Host", 4, r->authority);
  return NULL;
}

/* --- fields (RFC 9110, section 5; RFC 9112, sections 5 and 6) ----------------------------------------- */

const tcs_refusal *tcs_field_read(const char *line, size_t size, tcs_field *field) {
  size_t name = 0;
  if (size && (line[0] == ' ' || line[0] == '\t'))
    BAD("a line of the head begins with a blank; field lines are neither indented nor folded");
  while (name < size && is_token(line[name])) name++;
  if (name == 0 || name == size || line[name] != ':') BAD("a field line must be: name, colon without a space before it, value");
  size_t from = name + 1, to = size;
  while (from < to && (line[from] == ' ' || line[from] == '\t')) from++;
  while (to > from && (line[to - 1] == ' ' || line[to - 1] == '\t')) to--;
  for (size_t i = from; i < to; i++)
    if (g_ascii_iscntrl(line[i]) && line[i] != '\t') BAD("a field's value holds a control character");
  *field = (tcs_field){line, line + from, name, to - from};
  return NULL;
}

static const tcs_refusal *read_host(reader *r, slice value) {
  if (r->host) BAD("there is more than one Host field");
  if (!is_host(value)) BAD("the Host field is not a host with an optional port");
  r->host = true;
  if (!r->authority.size) put_field(r->plain, "Host", 4, value);
  return NULL;
}

static const tcs_refusal *read_length(reader *r, slice value) {
  if (r->length) BAD("there is more than one Content-Length field");
  if (value.size == 0 || !digits_only(value)) BAD("Content-Length must be one whole number");
  for (size_t i = 0; i < value.size; i++) {
    if (r->head.length > (uint64_t)INT64_MAX / 10 - 1) REFUSE(413, "limit", "Too large", "no body can be that long");
    r->head.length = r->head.length * 10 + (uint64_t)(value.at[i] - '0');
  }
  r->length = true;
  return NULL;
}

static const tcs_refusal *read_coding(reader *r, slice value) {
  const slice last = value.size >= 7 ? (slice){value.at + value.size - 7, 7} : (slice){0};
  if (r->http10) BAD("HTTP/1.0 has no Transfer-Encoding");
  if (r->coding || !same(last, "chunked")) BAD("Transfer-Encoding must end in chunked, once");
  if (value.size > 7)
    REFUSE(501, "coding", "Not implemented",
           "the only supported transfer coding is chunked, without another before it");
  r->coding = r->head.chunked = true;
  return NULL;
}

static const tcs_refusal *read_expect(reader *r, slice value) {
  if (r->http10) return NULL; /* RFC 9110, section 10.1.1: ignored */
  if (!same(value, "100-continue")) REFUSE(417, "expect", "Expectation failed", "the only supported Expect is 100-continue");
  r->expects = true;
  return NULL;
}

static const tcs_refusal *read_upgrade(reader *r, slice value) {
  char *text = g_strndup(value.at, value.size);
  if (!r->http10 && tcs_token_in(text, "websocket", true)) r->upgrade = value;
  g_free(text);
  return NULL;
}

/* Drops cookies: the server uses none, and a long Cookie field exhausts the library's memory for its parsed values, so
 * that it would close without a reply. */
static const tcs_refusal *read_cookie(reader *r, slice value) { return NULL; }

static const tcs_refusal *add_to_list(GString **list, slice value) {
  if (!*list) *list = g_string_new(NULL);
  if ((*list)->len && value.size) g_string_append(*list, ", "); /* an empty value adds no element */
  g_string_append_len(*list, value.at, (gssize)value.size);
  return NULL;
}

/* Duplicates of these fields are ambiguous. */
static const char *const ONCE[] = {"Content-Type", "Authorization", "Origin", "Sec-WebSocket-Version",
                                   "Sec-WebSocket-Key"};

static const tcs_refusal *read_field(reader *r, slice line) {
  static const struct {
    const char *name;
    const tcs_refusal *(*read)(reader *r, slice value);
  } framing[] = {{"Host", read_host},     {"Content-Length", read_length}, {"Transfer-Encoding", read_coding},
                 {"Expect", read_expect}, {"Upgrade", read_upgrade},       {"Cookie", read_cookie}};
  tcs_field field;
  const tcs_refusal *refusal = tcs_field_read(line.at, line.size, &field);
  if (refusal) return refusal;
  if (++r->fields > TCS_HEAD_FIELDS) REFUSE(431, "limit", "Too large", "the head has too many fields");
  const slice name = {field.name, field.name_size}, value = {field.value, field.value_size};
  for (size_t i = 0; i < G_N_ELEMENTS(framing); i++)
    if (same(name, framing[i].name)) return framing[i].read(r, value);
  for (int i = 0; i < LIST_COUNT; i++)
    if (same(name, LISTS[i])) return add_to_list(&r->lists[i], value);
  for (unsigned i = 0; i < G_N_ELEMENTS(ONCE); i++) {
    if (!same(name, ONCE[i])) continue;
    if (r->once & 1u << i) BAD("a field that may occur once occurs twice");
    r->once |= 1u << i;
  }
  put_field(r->plain, name.at, name.size, value);
  return NULL;
}

/* Checks that need the whole head; writes the framing in its canonical form. */
static const tcs_refusal *finish(reader *r) {
  char line[48];
  if (!r->host && !r->http10) BAD("HTTP/1.1 wants a Host field");
  if (r->coding && r->length) BAD("Content-Length and Transfer-Encoding exclude each other");
  if (r->coding) put_text(r->plain, "Transfer-Encoding: chunked\r\n");
  g_snprintf(line, sizeof line, "Content-Length: %" G_GUINT64_FORMAT "\r\n", r->head.length);
  if (r->length) put_text(r->plain, line);
  /* RFC 9110, section 10.1.1: a request without content expects nothing. libmicrohttpd answers 100 even so, and then
   * closes without a reply if another request follows. */
  if (r->expects && (r->coding || r->head.length)) put_text(r->plain, "Expect: 100-continue\r\n");
  /* RFC 9110, section 7.8: a server may ignore Upgrade. This one does for requests with a body. */
  r->head.upgrade = r->upgrade.size && !r->coding && !r->head.length;
  if (r->head.upgrade) put_field(r->plain, "Upgrade", 7, r->upgrade);
  for (int i = 0; i < LIST_COUNT; i++)
    if (r->lists[i]) put_field(r->plain, LISTS[i], strlen(LISTS[i]), (slice){r->lists[i]->str, r->lists[i]->len});
  put_text(r->plain, "\r\n");
  return NULL;
}

const tcs_refusal *tcs_head_read(const uint8_t *bytes, size_t size, tcs_head *head, GByteArray *plain) {
  reader r = {.plain = plain};
  const guint before = plain->len;
  const tcs_refusal *refusal = NULL;
  const char *at = (const char *)bytes, *end = at + size, *stop;
  for (bool first = true; !refusal; first = false, at = stop + 2) {
    stop = memmem(at, (size_t)(end - at), "\r\n", 2);
    if (!stop) break; /* not reached: the caller found the empty line */
    const slice line = {at, (size_t)(stop - at)};
    if (line.size == 0 && !first) break;
    refusal = first ? read_request_line(&r, line) : read_field(&r, line);
  }
  if (!refusal) refusal = finish(&r);
  for (int i = 0; i < LIST_COUNT; i++)
    if (r.lists[i]) g_string_free(r.lists[i], TRUE);
  *head = refusal ? (tcs_head){0} : r.head;
  if (refusal) g_byte_array_set_size(plain, before);
  return refusal;
}
