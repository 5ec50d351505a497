/* A strict parser for one request head (RFC 9112, RFC 9110), which writes the head again in a canonical form. Pure:
 * bytes in, bytes out.
 *
 * Protection against request smuggling: the HTTP library is lenient where two parsers of the same bytes can disagree on
 * the end of a request (two lengths, a blank before a colon, a lone CR, a NUL). It never sees such bytes: invalid heads
 * are refused here, and valid ones are rewritten so that only one reading is possible. */
#ifndef TCS_HTTP_HEAD_H
#define TCS_HTTP_HEAD_H

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

#define TCS_HEAD_BYTES 16384 /* limit on a whole head; more is 431 */
#define TCS_LINE_BYTES 8192  /* limit on the request line; more is 414. RFC 9112, section 3 recommends at least 8000 */
#define TCS_HEAD_FIELDS 100
#define TCS_QUERY_PARTS 64

/* A refusal: the last reply of a connection, which is then closed. `code` completes "urn:tomocast:problem:". */
typedef struct tcs_refusal {
  int status;
  const char *code, *title, *detail;
} tcs_refusal;

typedef struct tcs_head {
  bool chunked, upgrade; /* upgrade: the bytes after the head may not be HTTP */
  uint64_t length;       /* of the body, unless chunked */
} tcs_head;

/* Parses `bytes`: a head from its request line to its empty line, lines ended by CRLF. NULL: the canonical head was
 * appended to `plain`. Otherwise the refusal; `plain` is unchanged and *head zeroed. */
const tcs_refusal *tcs_head_read(const uint8_t *bytes, size_t size, tcs_head *head, GByteArray *plain);

/* A field line without its CRLF, from a head or a trailer: "Name: value". The value has no blanks around it. NULL:
 * valid. */
typedef struct tcs_field {
  const char *name, *value;
  size_t name_size, value_size;
} tcs_field;
const tcs_refusal *tcs_field_read(const char *line, size_t size, tcs_field *field);

#endif
