/* Lingering close (RFC 9112, section 9.6): closing a socket with unread bytes resets the connection, which can destroy
 * the reply before the peer reads it. So the sending side is shut down, and input is discarded until the peer closes,
 * within limits on time, bytes and connections. I/O thread only. */
#ifndef TCS_HTTP_LINGER_H
#define TCS_HTTP_LINGER_H

#include "server/loop/loop.h"

typedef struct tcs_linger tcs_linger;

tcs_linger *tcs_linger_new(tcs_loop *loop);
void tcs_linger_free(tcs_linger *linger); /* closes all; NULL is fine */

/* Call when a connection is about to be closed. `fd` stays the caller's; it is duplicated. */
void tcs_linger_add(tcs_linger *linger, int fd);
/* Once a second: closes those out of time. */
void tcs_linger_tick(tcs_linger *linger, int64_t now_us);

#endif
