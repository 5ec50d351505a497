/* A connection's incoming bytes between the socket and the HTTP library: whole heads in their plain form (head.h),
 * bodies as they are, chunks with canonical size lines, without extensions and trailers (RFC 9112, section 7.1). After
 * the first byte that is not by the book nothing more is let through: the library gets a request of its own making
 * instead, or the end of the body it is reading, and whoever answers finds the refusal here. Pure: bytes in, bytes out.
 */
#ifndef TCS_HTTP_STRICT_H
#define TCS_HTTP_STRICT_H

#include "server/http/head.h"

typedef struct tcs_strict tcs_strict;

tcs_strict *tcs_strict_new(void);
void tcs_strict_free(tcs_strict *strict); /* NULL is fine */

/* Bytes from the peer. Only while tcs_strict_hungry(): otherwise they had better stay in the socket. */
void tcs_strict_give(tcs_strict *strict, const uint8_t *bytes, size_t size);
bool tcs_strict_hungry(const tcs_strict *strict);
/* Bytes for the library: how many of at most `room`. */
size_t tcs_strict_take(tcs_strict *strict, uint8_t *bytes, size_t room);
/* How many of the peer's next bytes (at most `room`) are a body's, so that they need not come through here ... */
size_t tcs_strict_direct(const tcs_strict *strict, size_t room);
/* ... and that so many of them went past. */
void tcs_strict_passed(tcs_strict *strict, size_t size);

/* Heads let through, the one made for a refusal among them. */
unsigned tcs_strict_heads(const tcs_strict *strict);
/* Concerns the last of the heads; NULL: none so far. */
const tcs_refusal *tcs_strict_refusal(const tcs_strict *strict);
/* The last head asked for an upgrade: what came after it, which waits here. */
const GByteArray *tcs_strict_held(const tcs_strict *strict);

#endif
