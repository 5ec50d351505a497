#include "renderer/import/helper/names.h"

#include <stdbool.h>
#include <string.h>

#include "renderer/import/reader.h"

/* Parses the directive here, so that text of a header never becomes a format string. */
typedef struct pattern {
  char *before, *after;
  int width;
  bool zeros;
} pattern;

static char *unescape(const char *text, size_t length) {
  GString *plain = g_string_new(NULL);
  for (size_t i = 0; i < length; i++) {
    if (text[i] == '%') i++; /* "%%" */
    if (i < length) g_string_append_c(plain, text[i]);
  }
  return g_string_free(plain, FALSE);
}

/* Finds the first '%' that is not part of "%%". */
static const char *directive(const char *text) {
  for (const char *at = strchr(text, '%'); at; at = strchr(at + 2, '%')) {
    if (at[1] != '%') return at;
  }
  return NULL;
}

static bool split(const char *text, pattern *p) {
  *p = (pattern){0};
  const char *percent = directive(text);
  if (!percent) return false;
  const char *at = percent + 1;
  if (*at == '0') {
    p->zeros = true;
    at++;
  }
  for (int digits = 0; g_ascii_isdigit(*at); at++) {
    if (++digits > 2) return false;
    p->width = p->width * 10 + (*at - '0');
  }
  if ((*at != 'd' && *at != 'i' && *at != 'u') || directive(at + 1)) return false;
  p->before = unescape(text, (size_t)(percent - text));
  p->after = unescape(at + 1, strlen(at + 1));
  return true;
}

static bool expand(const pattern *p, const double *range, GPtrArray *names, GError **error) {
  double first = range[0], last = range[1], step = range[2];
  bool sane = step != 0 && (last - first) / step >= 0;
  for (int i = 0; i < 3; i++)
    if (!(range[i] >= INT32_MIN && range[i] <= INT32_MAX) || range[i] != (int32_t)range[i]) sane = false;
  if (!sane || first < 0 || last < 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "data file pattern: first, last and step are no range of whole numbers");
    return false;
  }
  if ((last - first) / step >= TC_MAX_DATA_FILES) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "data file pattern: more than %d files", TC_MAX_DATA_FILES);
    return false;
  }
  int64_t count = (int64_t)((last - first) / step) + 1;
  for (int64_t i = 0; i < count; i++) {
    int number = (int)(first + (double)i * step);
    char digits[128];
    g_snprintf(digits, sizeof digits, p->zeros ? "%0*d" : "%*d", p->width, number);
    g_ptr_array_add(names, g_strconcat(p->before, digits, p->after, NULL));
  }
  return true;
}

bool tc_names_from_pattern(const char *text, GPtrArray *names, int64_t *rest, GError **error) {
  char **words = g_strsplit_set(text, " \t", 2);
  pattern p = {0};
  double range[4];
  int count = words[0] && words[1] ? tc_text_numbers(words[1], range, 4) : -1;
  bool ok = false;
  if (count < 3 || count > 4 || !split(words[0], &p)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "data file pattern: NAME%%d FIRST LAST STEP expected");
  } else {
    ok = expand(&p, range, names, error);
    if (rest) *rest = count == 4 && range[3] >= 1 && range[3] <= 16 ? (int64_t)range[3] : -1;
  }
  g_free(p.before);
  g_free(p.after);
  g_strfreev(words);
  return ok;
}
