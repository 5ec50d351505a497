/* The end of a connection whose peer may still be writing (RFC 9112, section 9.6): closing a socket with bytes unread
 * resets it, which can destroy the answer before it was read. So no more is sent, and what comes is thrown away until
 * the peer closes too: for some time, up to some bytes, of some connections at once. I/O thread only. */
#ifndef TCS_HTTP_LINGER_H
#define TCS_HTTP_LINGER_H

#include "server/loop/loop.h"

typedef struct tcs_linger tcs_linger;

tcs_linger *tcs_linger_new(tcs_loop *loop);
void tcs_linger_free(tcs_linger *linger); /* closes what is left; NULL is fine */

/* For a connection that is about to be closed. `fd` stays the caller's: it is duplicated. */
void tcs_linger_add(tcs_linger *linger, int fd);
/* Once a second. */
void tcs_linger_tick(tcs_linger *linger, int64_t now_us);

#endif
