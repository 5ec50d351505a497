/* The bounded reader: every header of every format is read through it.
 *
 * It never reads past its bytes. A read that would returns 0 and sets `failed`, so a parser reads a whole
 * header and asks once at the end. Plain value, no heap; the bytes must outlive it. */
#ifndef TC_IMPORT_READER_H
#define TC_IMPORT_READER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct tc_reader {
  const uint8_t *bytes; /* [size] */
  size_t size, at;
  bool big_endian;
  bool failed; /* some read went past the end; stays set */
} tc_reader;

void tc_reader_init(tc_reader *reader, const void *bytes, size_t size, bool big_endian);

/* Moves to an absolute position; past the end sets `failed`. */
void tc_reader_seek(tc_reader *reader, size_t at);
size_t tc_reader_left(const tc_reader *reader);

uint8_t tc_reader_u8(tc_reader *reader);
uint16_t tc_reader_u16(tc_reader *reader);
uint32_t tc_reader_u32(tc_reader *reader);
uint64_t tc_reader_u64(tc_reader *reader);
int16_t tc_reader_i16(tc_reader *reader);
int32_t tc_reader_i32(tc_reader *reader);
int64_t tc_reader_i64(tc_reader *reader);
float tc_reader_f32(tc_reader *reader);
double tc_reader_f64(tc_reader *reader);

/* The next text line as a fresh C string without its end (LF or CRLF); NULL when nothing is left. A line longer
 * than `longest` bytes sets `failed` and gives NULL. Caller frees with g_free(). */
char *tc_reader_line(tc_reader *reader, size_t longest);

/* Reads blank-separated numbers ("1 2.5 nan") up to `max` of them into values[]. Returns how many there are; -1 when
 * something is no number. More than `max` numbers give max + 1. Locale-free. */
int tc_text_numbers(const char *text, double *values, int max);

/* A whole decimal integer in [lo, hi], blanks around it allowed. */
bool tc_text_integer(const char *text, int64_t lo, int64_t hi, int64_t *value);

/* A short printable copy of text from a file for use in a message; at most 60 characters. Caller frees (g_free). */
char *tc_text_quote(const char *text);

#endif
