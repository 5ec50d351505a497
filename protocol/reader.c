/* Position in a document, and error messages. */
#include <stdarg.h>
#include <string.h>

#include "protocol/internal.h"

/* Limits on quoted client text, and on names compared with known ones. */
#define QUOTE_CHARACTERS 40
#define NAME_BYTES 48

size_t tcp_enter(tcp_reader *reader, const char *name) {
  size_t mark = reader->pointer->len;
  g_string_append_c(reader->pointer, '/');
  for (const char *c = name; *c; c++) {
    if (*c == '~')
      g_string_append(reader->pointer, "~0");
    else if (*c == '/')
      g_string_append(reader->pointer, "~1");
    else
      g_string_append_c(reader->pointer, *c);
  }
  return mark;
}

size_t tcp_enter_index(tcp_reader *reader, int index) {
  size_t mark = reader->pointer->len;
  g_string_append_printf(reader->pointer, "/%d", index);
  return mark;
}

void tcp_leave(tcp_reader *reader, size_t mark) { g_string_truncate(reader->pointer, mark); }

char *tcp_quote(const char *text) {
  GString *out = g_string_new("\"");
  int characters = 0;
  for (const char *p = text; *p; p = g_utf8_next_char(p)) {
    gunichar c = g_utf8_get_char(p);
    if (characters++ == QUOTE_CHARACTERS) {
      g_string_append(out, "...");
      break;
    }
    g_string_append_unichar(out, g_unichar_isprint(c) ? c : '?');
  }
  g_string_append_c(out, '"');
  return g_string_free(out, FALSE);
}

/* "/transferFunction/points/3/value" becomes "transferFunction.points[3].value". */
static char *dotted_path(const char *pointer) {
  GString *path = g_string_new(NULL);
  char **segments = g_strsplit(*pointer ? pointer + 1 : "", "/", -1);
  for (char **s = segments; *s; s++) {
    bool number = **s && strspn(*s, "0123456789") == strlen(*s);
    if (number && path->len)
      g_string_append_printf(path, "[%s]", *s);
    else
      g_string_append_printf(path, "%s%s", path->len ? "." : "", *s);
  }
  g_strfreev(segments);
  char *quoted = tcp_quote(path->str); /* it may contain a member name from the client */
  char *plain = g_strndup(quoted + 1, strlen(quoted) - 2);
  g_free(quoted);
  g_string_free(path, TRUE);
  return plain;
}

static bool fail_va(GError **error, tc_error_code code, const char *pointer, const char *format, va_list args) {
  char *path = dotted_path(pointer), *message = g_strdup_vprintf(format, args);
  tc_set_error(error, code, pointer, "%s%s%s", path, *path ? ": " : "", message);
  g_free(path);
  g_free(message);
  return false;
}

bool tcp_fail_at(GError **error, tc_error_code code, const char *pointer, const char *format, ...) {
  va_list args;
  va_start(args, format);
  fail_va(error, code, pointer, format, args);
  va_end(args);
  return false;
}

bool tcp_fail(tcp_reader *reader, tc_error_code code, const char *format, ...) {
  va_list args;
  va_start(args, format);
  fail_va(reader->error, code, reader->pointer->str, format, args);
  va_end(args);
  return false;
}

static const char *kind_of(const cJSON *value) {
  if (cJSON_IsNull(value)) return "null";
  if (cJSON_IsBool(value)) return "true or false";
  if (cJSON_IsNumber(value)) return "a number";
  if (cJSON_IsString(value)) return "a string";
  return cJSON_IsArray(value) ? "an array" : "an object";
}

bool tcp_fail_type(tcp_reader *reader, const char *what, const cJSON *value) {
  return tcp_fail(reader, TC_ERROR_INVALID, "%s expected, not %s", what, kind_of(value));
}

/* --- "did you mean" --------------------------------------------------------------------------- */

static int least(int a, int b) { return a < b ? a : b; }

/* Edit distance (insert, delete, replace, swap of neighbours; case ignored): optimal string alignment. */
static int distance(const char *a, const char *b) {
  int la = (int)strlen(a), lb = (int)strlen(b), rows[3][NAME_BYTES + 1];
  int *before = rows[0], *last = rows[1], *now = rows[2];
  for (int j = 0; j <= lb; j++) last[j] = j;
  for (int i = 1; i <= la; i++) {
    now[0] = i;
    for (int j = 1; j <= lb; j++) {
      char x = g_ascii_tolower(a[i - 1]), y = g_ascii_tolower(b[j - 1]);
      now[j] = least(least(last[j], now[j - 1]) + 1, last[j - 1] + (x != y));
      if (i > 1 && j > 1 && x == g_ascii_tolower(b[j - 2]) && y == g_ascii_tolower(a[i - 2]))
        now[j] = least(now[j], before[j - 2] + 1);
    }
    int *spare = before;
    before = last;
    last = now;
    now = spare;
  }
  return last[lb];
}

/* Removes separators, so that max_error matches maxError. */
static void squeeze(const char *from, char *to) {
  for (; *from; from++)
    if (*from != '_' && *from != '-') *to++ = *from;
  *to = 0;
}

const char *tcp_nearest(const char *name, const char *const *candidates) {
  char squeezed[NAME_BYTES + 1], other[NAME_BYTES + 1];
  const char *best = NULL;
  int best_distance = 3;
  if (strlen(name) > NAME_BYTES) return NULL;
  squeeze(name, squeezed);
  for (; *candidates; candidates++) {
    if (strlen(*candidates) > NAME_BYTES) continue;
    squeeze(*candidates, other);
    int d = distance(squeezed, other);
    /* two of three letters wrong is another word */
    if (d < best_distance && 2 * d < (int)strlen(other)) best = *candidates, best_distance = d;
  }
  return best;
}

char *tcp_hint(const char *name, const char *const *candidates) {
  const char *near = tcp_nearest(name, candidates);
  if (near) return g_strdup_printf("; did you mean \"%s\"?", near);
  char *all = g_strjoinv(", ", (char **)candidates);
  char *hint = g_strdup_printf("; known: %s", all);
  g_free(all);
  return hint;
}
