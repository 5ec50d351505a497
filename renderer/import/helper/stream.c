#include "renderer/import/helper/stream.h"

#include <string.h>

static bool watch(void *user, GError **error) {
  const tc_stream *s = user;
  const double part = s->input->packing == TC_ENCODING_RAW ? (double)s->fetched / (double)MAX(s->input->size, 1) : 0;
  return s->order->goes_on(s->order->user, MIN(part, 1), error);
}

bool tc_stream_open(tc_stream *s, const tc_input *input, const tc_order *order, GError **error) {
  *s = (tc_stream){.input = input, .order = order};
  s->decoder = tc_decoder_new(input, 0, input->packing, TC_ELEMENT_U8, 0, error);
  if (!s->decoder) return false;
  tc_decoder_watch(s->decoder, watch, s);
  s->buffer = g_malloc(TC_STREAM_MOST_BYTES + 1);
  return true;
}

void tc_stream_close(tc_stream *s) {
  tc_decoder_free(s->decoder);
  g_free(s->buffer);
  *s = (tc_stream){0};
}

/* Reads more bytes behind those in the buffer; *more is false at the end of the file. */
static bool refill(tc_stream *s, bool *more, GError **error) {
  size_t got = 0;
  if (!watch(s, error)) return false;
  memmove(s->buffer, s->buffer + s->at, s->size - s->at);
  s->size -= s->at;
  s->at = 0;
  if (!tc_decoder_read(s->decoder, s->buffer + s->size, TC_STREAM_MOST_BYTES - s->size, &got, error)) return false;
  s->size += got;
  s->fetched += got;
  *more = got > 0;
  if (got > 0 || !tc_decoder_cut(s->decoder)) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "compressed data end before their check sum: fetch the file again");
  return false;
}

const uint8_t *tc_stream_take(tc_stream *s, size_t n, GError **error) {
  bool more = true;
  while (s->size - s->at < n && more)
    if (!refill(s, &more, error)) return NULL;
  if (s->size - s->at < n) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "the file is cut short after %" G_GUINT64_FORMAT " bytes: fetch it again",
                 s->fetched);
    return NULL;
  }
  s->at += n;
  return s->buffer + s->at - n;
}

/* Finds the end of the line at `at` and joins continued lines; NULL: the end is not in the buffer. */
static char *find_end(tc_stream *s, size_t *looked) {
  for (char *end; (end = memchr(s->buffer + s->at + *looked, '\n', s->size - s->at - *looked));) {
    char *start = (char *)s->buffer + s->at, *last = end;
    if (last > start && last[-1] == '\r') last--;
    s->line++;
    if (last == start || last[-1] != '\\') return end;
    memset(last - 1, ' ', (size_t)(end - last) + 2);
    *looked = (size_t)(end - start);
  }
  *looked = s->size - s->at;
  return NULL;
}

char *tc_stream_line(tc_stream *s, GError **error) {
  bool more = true;
  const bool first = s->line == 0;
  size_t looked = 0;
  char *end = find_end(s, &looked);
  while (!end && more) {
    if (s->size - s->at == TC_STREAM_MOST_BYTES) {
      tc_set_error(error, TC_ERROR_FORMAT, NULL, "line %zu is longer than 1 MiB; save the file anew", s->line + 1);
      return NULL;
    }
    if (!refill(s, &more, error)) return NULL;
    end = find_end(s, &looked);
  }
  if (!end && s->at == s->size) return NULL;
  char *start = (char *)s->buffer + s->at;
  if (!end) {
    end = (char *)s->buffer + s->size; /* the buffer has one more byte */
    s->line++;
  }
  s->at = MIN((size_t)(end - (char *)s->buffer) + 1, s->size);
  *end = 0;
  if (end > start && end[-1] == '\r') end[-1] = 0;
  if (first && strncmp(start, "\xef\xbb\xbf", 3) == 0) start += 3; /* byte order mark */
  return start;
}

bool tc_line_number(char **line, double *number) {
  char *end;
  *number = g_ascii_strtod(*line, &end); /* skips blanks */
  if (end == *line || (*end && !g_ascii_isspace(*end))) return false;
  *line = end;
  return true;
}

char *tc_line_word(char **line) {
  char *word = *line + strspn(*line, " \t"), *end = word + strcspn(word, " \t");
  *line = *end ? end + 1 : end;
  *end = 0;
  return word;
}
