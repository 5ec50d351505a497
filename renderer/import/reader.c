#include "renderer/import/reader.h"

#include <errno.h>
#include <glib.h>
#include <stdlib.h>
#include <string.h>

void tc_reader_init(tc_reader *reader, const void *bytes, size_t size, bool big_endian) {
  *reader = (tc_reader){.bytes = bytes, .size = size, .big_endian = big_endian};
}

void tc_reader_seek(tc_reader *reader, size_t at) {
  if (at > reader->size)
    reader->failed = true;
  else
    reader->at = at;
}

size_t tc_reader_left(const tc_reader *reader) { return reader->size - reader->at; }

/* Reads an integer of n bytes in the reader's byte order. */
static uint64_t take(tc_reader *reader, size_t n) {
  if (n > tc_reader_left(reader)) {
    reader->failed = true;
    return 0;
  }
  const uint8_t *from = reader->bytes + reader->at;
  uint64_t value = 0;
  for (size_t i = 0; i < n; i++) value = value << 8 | from[reader->big_endian ? i : n - 1 - i];
  reader->at += n;
  return value;
}

uint8_t tc_reader_u8(tc_reader *reader) { return (uint8_t)take(reader, 1); }
uint16_t tc_reader_u16(tc_reader *reader) { return (uint16_t)take(reader, 2); }
uint32_t tc_reader_u32(tc_reader *reader) { return (uint32_t)take(reader, 4); }
uint64_t tc_reader_u64(tc_reader *reader) { return take(reader, 8); }
int16_t tc_reader_i16(tc_reader *reader) { return (int16_t)take(reader, 2); }
int32_t tc_reader_i32(tc_reader *reader) { return (int32_t)take(reader, 4); }
int64_t tc_reader_i64(tc_reader *reader) { return (int64_t)take(reader, 8); }

float tc_reader_f32(tc_reader *reader) {
  uint32_t bits = tc_reader_u32(reader);
  float value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

double tc_reader_f64(tc_reader *reader) {
  uint64_t bits = tc_reader_u64(reader);
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

char *tc_reader_line(tc_reader *reader, size_t longest) {
  size_t left = tc_reader_left(reader);
  if (left == 0) return NULL;
  const char *start = (const char *)reader->bytes + reader->at;
  const char *end = memchr(start, '\n', left);
  size_t length = end ? (size_t)(end - start) : left;
  if (length > longest) {
    reader->failed = true;
    return NULL;
  }
  reader->at += length + (end ? 1 : 0);
  if (length > 0 && start[length - 1] == '\r') length--;
  return g_strndup(start, length);
}

int tc_text_numbers(const char *text, double *values, int max) {
  int count = 0;
  for (;;) {
    while (g_ascii_isspace(*text)) text++;
    if (*text == '\0') return count;
    if (count == max) return max + 1;
    char *end;
    values[count] = g_ascii_strtod(text, &end);
    if (end == text || (*end != '\0' && !g_ascii_isspace(*end))) return -1;
    count++;
    text = end;
  }
}

bool tc_text_integer(const char *text, int64_t lo, int64_t hi, int64_t *value) {
  char *end;
  errno = 0;
  int64_t number = g_ascii_strtoll(text, &end, 10);
  if (end == text || errno == ERANGE) return false;
  while (g_ascii_isspace(*end)) end++;
  if (*end != '\0' || number < lo || number > hi) return false;
  *value = number;
  return true;
}

char *tc_text_quote(const char *text) {
  enum { longest = 60 };
  GString *quoted = g_string_new("'");
  for (size_t i = 0; text[i] != '\0' && i < longest; i++)
    g_string_append_c(quoted, g_ascii_isprint(text[i]) ? text[i] : '?');
  if (strlen(text) > longest) g_string_append(quoted, "...");
  g_string_append_c(quoted, '\'');
  return g_string_free(quoted, FALSE);
}
