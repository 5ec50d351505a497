/* Filter between the socket and the HTTP library: passes whole heads in canonical form (head.h), bodies unchanged, and
 * chunks with canonical size lines, without extensions and trailers (RFC 9112, section 7.1). After the first invalid
 * byte nothing more passes: the library gets a made-up request, or an early end of the current body, and the request
 * handler finds the refusal here. Pure: bytes in, bytes out. */
#ifndef TCS_HTTP_STRICT_H
#define TCS_HTTP_STRICT_H

#include "server/http/head.h"

typedef struct tcs_strict tcs_strict;

tcs_strict *tcs_strict_new(void);
void tcs_strict_free(tcs_strict *strict); /* NULL is fine */

/* Gives bytes from the peer. Only while tcs_strict_hungry(); otherwise leave them in the socket. */
void tcs_strict_give(tcs_strict *strict, const uint8_t *bytes, size_t size);
bool tcs_strict_hungry(const tcs_strict *strict);
/* Takes bytes for the library, at most `room`. Returns their number. */
size_t tcs_strict_take(tcs_strict *strict, uint8_t *bytes, size_t room);
/* How many of the peer's next bytes (at most `room`) belong to a body and may bypass the filter ... */
size_t tcs_strict_direct(const tcs_strict *strict, size_t room);
/* ... and how many did bypass it. */
void tcs_strict_passed(tcs_strict *strict, size_t size);

/* Number of heads passed to the library, including the one made up for a refusal. */
unsigned tcs_strict_heads(const tcs_strict *strict);
/* The refusal of the last head or its body; NULL: none so far. */
const tcs_refusal *tcs_strict_refusal(const tcs_strict *strict);
/* After an upgrade request: the bytes received after its head, which are kept here. */
const GByteArray *tcs_strict_held(const tcs_strict *strict);

#endif
