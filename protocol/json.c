/* Strict JSON in front of cJSON, and RFC 7396.
 *
 * cJSON accepts more than JSON (duplicate names, trailing text, numbers that overflow, "\u0000" that cuts a string
 * short), recurses without limit and cannot say where a text is wrong. Therefore a scanner first walks the whole text
 * without building anything, checks the grammar of RFC 8259 and tracks line and column; only valid text reaches cJSON.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "protocol/internal.h"

#define MAX_DEPTH 32
/* cJSON copies a number into 64 bytes. Enough for 17 digits with point, sign and exponent, which need 25. */
#define MAX_NUMBER 63
#define FEW_NAMES 16

typedef struct slice {
  const char *text;
  size_t size;
} slice;

typedef struct scanner {
  const char *start, *at, *end;
  int depth;
  guint seed;            /* seed of the name hash, so that a client cannot prepare collisions */
  GStringChunk *decoded; /* names with escapes; created on demand */
  GError **error;
} scanner;

static bool scan_value(scanner *s);

static bool fail(scanner *s, const char *what) {
  size_t line = 1;
  const char *line_start = s->start;
  for (const char *p = s->start; p < s->at; p++)
    if (*p == '\n') line++, line_start = p + 1;
  tc_set_error(s->error, TC_ERROR_SYNTAX, NULL, "JSON line %zu column %zu: %s", line, (size_t)(s->at - line_start) + 1,
               what);
  return false;
}

static void skip_space(scanner *s) {
  while (s->at < s->end && (*s->at == ' ' || *s->at == '\t' || *s->at == '\n' || *s->at == '\r')) s->at++;
}

static bool at_digit(const scanner *s) { return s->at < s->end && *s->at >= '0' && *s->at <= '9'; }

static bool take(scanner *s, char c) {
  if (s->at == s->end || *s->at != c) return false;
  s->at++;
  return true;
}

/* --- numbers ---------------------------------------------------------------------------------- */

static bool scan_digits(scanner *s) {
  if (!at_digit(s)) return fail(s, "a digit expected here");
  while (at_digit(s)) s->at++;
  return true;
}

static bool scan_number(scanner *s) {
  const char *first = s->at;
  char copy[MAX_NUMBER + 1];
  take(s, '-');
  if (!take(s, '0') && !scan_digits(s)) return false;
  if (at_digit(s)) return fail(s, "a number must not start with 0");
  if (take(s, '.') && !scan_digits(s)) return false;
  if (take(s, 'e') || take(s, 'E')) {
    if (!take(s, '+')) take(s, '-');
    if (!scan_digits(s)) return false;
  }
  size_t size = (size_t)(s->at - first);
  if (size > MAX_NUMBER) {
    s->at = first;
    return fail(s, "a number may have at most 63 characters");
  }
  memcpy(copy, first, size);
  copy[size] = 0;
  if (isfinite(g_ascii_strtod(copy, NULL))) return true;
  s->at = first;
  return fail(s, "the number is too large for a double");
}

/* --- strings ---------------------------------------------------------------------------------- */

static bool scan_hex4(scanner *s, gunichar *code) {
  *code = 0;
  for (int i = 0; i < 4; i++, s->at++) {
    int digit = s->at < s->end ? g_ascii_xdigit_value(*s->at) : -1;
    if (digit < 0) return fail(s, "four hexadecimal digits expected after \\u");
    *code = *code * 16 + (gunichar)digit;
  }
  return true;
}

/* After "\u". Surrogates must be paired; U+0000 is refused, since it would end a C string early. */
static bool scan_unicode_escape(scanner *s, gunichar *code) {
  gunichar low;
  if (!scan_hex4(s, code)) return false;
  if (*code == 0) return fail(s, "the character U+0000 is not accepted");
  if (*code >= 0xDC00 && *code <= 0xDFFF) return fail(s, "a low surrogate without its high one");
  if (*code < 0xD800 || *code > 0xDBFF) return true;
  if (!take(s, '\\') || !take(s, 'u')) return fail(s, "a high surrogate without its low one");
  if (!scan_hex4(s, &low)) return false;
  if (low < 0xDC00 || low > 0xDFFF) return fail(s, "a high surrogate without its low one");
  *code = 0x10000 + ((*code - 0xD800) << 10) + (low - 0xDC00);
  return true;
}

static bool scan_escape(scanner *s, GString *out) {
  static const char from[] = "\"\\/bfnrt", to[] = "\"\\/\b\f\n\r\t";
  gunichar code;
  if (s->at == s->end) return fail(s, "the string does not end");
  if (take(s, 'u')) {
    if (!scan_unicode_escape(s, &code)) return false;
  } else {
    const char *found = *s->at ? strchr(from, *s->at) : NULL;
    if (!found) return fail(s, "an unknown escape; JSON has \\\" \\\\ \\/ \\b \\f \\n \\r \\t \\uXXXX");
    code = (gunichar)to[found - from];
    s->at++;
  }
  if (out) g_string_append_unichar(out, code);
  return true;
}

/* At the opening quote. The text is known to be valid UTF-8. Appends the decoded text to `out`, if given. */
static bool scan_string(scanner *s, GString *out) {
  if (!take(s, '"')) return fail(s, "a string is wanted here");
  while (s->at < s->end && *s->at != '"') {
    if ((unsigned char)*s->at < 0x20) return fail(s, "a control character in a string; write it as an escape");
    if (take(s, '\\')) {
      if (!scan_escape(s, out)) return false;
    } else {
      if (out) g_string_append_c(out, *s->at);
      s->at++;
    }
  }
  return take(s, '"') || fail(s, "the string does not end");
}

/* --- objects ---------------------------------------------------------------------------------- */

/* Names of one object: an array for a few, a hash table for many. */
typedef struct names {
  slice few[FEW_NAMES];
  int count;
  GHashTable *many; /* slice * -> itself */
} names;

/* The key carries the seed, since GLib's hash functions have no user data. */
typedef struct seeded {
  slice name;
  guint seed;
} seeded;

static guint seeded_hash(gconstpointer key) {
  const seeded *k = key;
  guint64 h = 0xcbf29ce484222325u ^ k->seed;
  for (size_t i = 0; i < k->name.size; i++) h = (h ^ (unsigned char)k->name.text[i]) * 0x100000001b3u;
  return (guint)(h ^ h >> 32);
}

static gboolean seeded_equal(gconstpointer a, gconstpointer b) {
  const seeded *x = a, *y = b;
  return x->name.size == y->name.size && memcmp(x->name.text, y->name.text, x->name.size) == 0;
}

static bool names_add_many(names *n, slice name, guint seed) {
  seeded *key = g_new(seeded, 1);
  *key = (seeded){name, seed};
  return g_hash_table_add(n->many, key);
}

/* False: duplicate name. */
static bool names_add(names *n, slice name, guint seed) {
  if (n->many) return names_add_many(n, name, seed);
  for (int i = 0; i < n->count; i++)
    if (n->few[i].size == name.size && memcmp(n->few[i].text, name.text, name.size) == 0) return false;
  if (n->count < FEW_NAMES) {
    n->few[n->count++] = name;
    return true;
  }
  n->many = g_hash_table_new_full(seeded_hash, seeded_equal, g_free, NULL);
  for (int i = 0; i < n->count; i++) names_add_many(n, n->few[i], seed);
  return names_add_many(n, name, seed);
}

/* Decodes a member name: "a" and "\u0061" are the same name. */
static bool scan_name(scanner *s, slice *name) {
  const char *first = s->at;
  if (!scan_string(s, NULL)) return false;
  *name = (slice){first + 1, (size_t)(s->at - first) - 2};
  if (!memchr(name->text, '\\', name->size)) return true;
  GString *text = g_string_new(NULL);
  s->at = first;
  scan_string(s, text);
  if (!s->decoded) s->decoded = g_string_chunk_new(256);
  *name = (slice){g_string_chunk_insert_len(s->decoded, text->str, (gssize)text->len), text->len};
  g_string_free(text, TRUE);
  return true;
}

static bool scan_member(scanner *s, names *seen) {
  const char *first = s->at;
  slice name;
  if (!scan_name(s, &name)) return false;
  if (!names_add(seen, name, s->seed)) {
    s->at = first;
    return fail(s, "this member name occurs twice in one object");
  }
  skip_space(s);
  if (!take(s, ':')) return fail(s, "':' expected after a member name");
  return scan_value(s);
}

/* After '{'. */
static bool scan_members(scanner *s, names *seen) {
  skip_space(s);
  if (take(s, '}')) return true;
  do {
    skip_space(s);
    if (!scan_member(s, seen)) return false;
    skip_space(s);
  } while (take(s, ','));
  return take(s, '}') || fail(s, "',' or '}' expected here");
}

static bool scan_object(scanner *s) {
  names seen = {.count = 0};
  bool good = scan_members(s, &seen);
  if (seen.many) g_hash_table_destroy(seen.many);
  return good;
}

/* After '['. */
static bool scan_array(scanner *s) {
  skip_space(s);
  if (take(s, ']')) return true;
  do {
    if (!scan_value(s)) return false;
    skip_space(s);
  } while (take(s, ','));
  return take(s, ']') || fail(s, "',' or ']' expected here");
}

static bool scan_word(scanner *s, const char *word) {
  size_t size = strlen(word);
  if ((size_t)(s->end - s->at) < size || memcmp(s->at, word, size) != 0) return fail(s, "not a JSON value");
  s->at += size;
  return true;
}

static bool scan_container(scanner *s) {
  if (++s->depth > MAX_DEPTH) return fail(s, "nested deeper than 32");
  bool good = *s->at++ == '{' ? scan_object(s) : scan_array(s);
  s->depth--;
  return good;
}

/* Recursion is bounded by MAX_DEPTH. */
static bool scan_value(scanner *s) {
  skip_space(s);
  if (s->at == s->end) return fail(s, "the text ends where a value is expected");
  switch (*s->at) {
  case '{':
  case '[': return scan_container(s);
  case '"': return scan_string(s, NULL);
  case 't': return scan_word(s, "true");
  case 'f': return scan_word(s, "false");
  case 'n': return scan_word(s, "null");
  default: break;
  }
  return *s->at == '-' || at_digit(s) ? scan_number(s) : fail(s, "not a JSON value");
}

static bool scan_document(scanner *s) {
  const char *bad;
  if (!g_utf8_validate_len(s->start, (gsize)(s->end - s->start), &bad)) {
    s->at = bad;
    return fail(s, *bad ? "not valid UTF-8" : "a zero byte");
  }
  if (!scan_value(s)) return false;
  skip_space(s);
  return s->at == s->end || fail(s, "text after the end of the value");
}

cJSON *tcp_json_parse(const char *bytes, size_t size, GError **error) {
  scanner s = {.start = bytes, .at = bytes, .end = bytes + size, .seed = g_random_int(), .error = error};
  cJSON *value = NULL;
  if (size && scan_document(&s)) {
    value = cJSON_ParseWithLengthOpts(bytes, size, NULL, 0);
    if (!value) tc_set_error(error, TC_ERROR_MEMORY, NULL, "JSON: no memory for %zu bytes of text", size);
  } else if (!size) {
    tc_set_error(error, TC_ERROR_SYNTAX, NULL, "JSON line 1 column 1: the text is empty");
  }
  if (s.decoded) g_string_chunk_free(s.decoded);
  return value;
}

/* --- RFC 7396 --------------------------------------------------------------------------------- */

/* Index of the members, since cJSON searches linearly: a patch of thousands of members would take quadratic time. */
static GHashTable *index_members(cJSON *object) {
  GHashTable *index = g_hash_table_new(g_str_hash, g_str_equal);
  for (cJSON *item = object->child; item; item = item->next)
    if (item->string) g_hash_table_insert(index, item->string, item);
  return index;
}

static void merge_member(cJSON *object, GHashTable *index, const cJSON *patch) {
  cJSON *old = g_hash_table_lookup(index, patch->string);
  if (old) {
    g_hash_table_remove(index, patch->string);
    cJSON_DetachItemViaPointer(object, old);
  }
  if (cJSON_IsNull(patch)) {
    cJSON_Delete(old);
    return;
  }
  tcp_merge_patch(&old, patch);
  if (old && cJSON_AddItemToObject(object, patch->string, old))
    g_hash_table_insert(index, old->string, old);
  else
    cJSON_Delete(old);
}

/* Recursion depth is that of the patch, which tcp_json_parse() bounds. */
void tcp_merge_patch(cJSON **target, const cJSON *patch) {
  if (!cJSON_IsObject(patch)) {
    cJSON_Delete(*target);
    *target = cJSON_Duplicate(patch, true);
    return;
  }
  if (!cJSON_IsObject(*target)) {
    cJSON_Delete(*target);
    *target = cJSON_CreateObject();
    if (!*target) return;
  }
  GHashTable *index = index_members(*target);
  for (const cJSON *item = patch->child; item; item = item->next) merge_member(*target, index, item);
  g_hash_table_destroy(index);
}
