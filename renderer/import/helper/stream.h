/* A file read from its start, unpacked as it comes: as lines of text or as bytes, in any order of the two. */
#ifndef TC_IMPORT_STREAM_H
#define TC_IMPORT_STREAM_H

#include "renderer/import/helper/decode.h"
#include "renderer/import/helper/order.h"

enum { TC_STREAM_MOST_BYTES = 1 << 20 }; /* of a line, and of what is taken at a time */

typedef struct tc_stream {
  const tc_input *input;
  const tc_order *order; /* asked at every refill whether to go on */
  tc_decoder *decoder;
  uint8_t *buffer; /* [TC_STREAM_MOST_BYTES + 1] */
  size_t at, size; /* what is next in it, and its end */
  uint64_t fetched;
  size_t line; /* number of the line that was read last, from 1 */
} tc_stream;

/* Both outlive the stream. */
bool tc_stream_open(tc_stream *stream, const tc_input *input, const tc_order *order, GError **error);
void tc_stream_close(tc_stream *stream);

/* Exactly n bytes, at most TC_STREAM_MOST_BYTES, good until the next call; NULL with an error where there are fewer. */
const uint8_t *tc_stream_take(tc_stream *stream, size_t n, GError **error);

/* The next line without its end, good until the next call; one that ends in '\' goes on in the next. NULL: the file has
 * ended, or *error says why not. */
char *tc_stream_line(tc_stream *stream, GError **error);

/* The next number of a line, which moves on behind it; false: there is none. */
bool tc_line_number(char **line, double *number);
/* The next word of a line, ended in place, or "". */
char *tc_line_word(char **line);

#endif
