/* A file read from its start and unpacked on the fly, as text lines or bytes in any order. */
#ifndef TC_IMPORT_STREAM_H
#define TC_IMPORT_STREAM_H

#include "renderer/import/helper/decode.h"
#include "renderer/import/helper/order.h"

enum { TC_STREAM_MOST_BYTES = 1 << 20 }; /* largest line, and largest read */

typedef struct tc_stream {
  const tc_input *input;
  const tc_order *order; /* asked at every refill whether to continue */
  tc_decoder *decoder;
  uint8_t *buffer; /* [TC_STREAM_MOST_BYTES + 1] */
  size_t at, size; /* next position and end in the buffer */
  uint64_t fetched;
  size_t line; /* number of the last line read, from 1 */
} tc_stream;

/* Both outlive the stream. */
bool tc_stream_open(tc_stream *stream, const tc_input *input, const tc_order *order, GError **error);
void tc_stream_close(tc_stream *stream);

/* Returns exactly n bytes, at most TC_STREAM_MOST_BYTES, valid until the next call; NULL with an error if fewer are
 * left. */
const uint8_t *tc_stream_take(tc_stream *stream, size_t n, GError **error);

/* Returns the next line without its end, valid until the next call; a line that ends in '\' continues in the next.
 * NULL at the end of the file, or with *error set. */
char *tc_stream_line(tc_stream *stream, GError **error);

/* Parses the next number of a line and advances *line; false: there is none. */
bool tc_line_number(char **line, double *number);
/* Returns the next word of a line, terminated in place, or "". */
char *tc_line_word(char **line);

#endif
