/* One request head by RFC 9112 and RFC 9110, read strictly and written again in one plain form. Pure: bytes in, bytes
 * out.
 *
 * The library that answers requests is lenient where two readers of the same bytes can disagree on where a request ends
 * (two lengths, a blank before a colon, a lone CR, a NUL). So it never sees such bytes: what is not by the book is
 * refused here, the rest is written out with one reading only. */
#ifndef TCS_HTTP_HEAD_H
#define TCS_HTTP_HEAD_H

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

#define TCS_HEAD_BYTES 16384 /* of a whole head; more is 431 */
#define TCS_LINE_BYTES 8192  /* of the request line; more is 414. RFC 9112, section 3 asks for 8000 at least */
#define TCS_HEAD_FIELDS 100
#define TCS_QUERY_PARTS 64

/* Why a connection gets a last answer and is closed. `code` completes "urn:tomocast:problem:". */
typedef struct tcs_refusal {
  int status;
  const char *code, *title, *detail;
} tcs_refusal;

typedef struct tcs_head {
  bool chunked, upgrade; /* upgrade: what follows is perhaps no HTTP */
  uint64_t length;       /* of the body, where it is not chunked */
} tcs_head;

/* `bytes`: a head from its request line to its empty line, lines ended by CRLF. NULL: `plain` has it appended.
 * Otherwise `plain` is as it was, and *head holds nothing. */
const tcs_refusal *tcs_head_read(const uint8_t *bytes, size_t size, tcs_head *head, GByteArray *plain);

/* A field line without its CRLF, as it stands in a head or among trailers: "Name: value". The value is without the
 * blanks around it. NULL: it is one. */
typedef struct tcs_field {
  const char *name, *value;
  size_t name_size, value_size;
} tcs_field;
const tcs_refusal *tcs_field_read(const char *line, size_t size, tcs_field *field);

#endif
