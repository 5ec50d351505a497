/* Puts strict.h between a connection's socket and libmicrohttpd, which reads with recv() and has no hook for incoming
 * bytes: guard.c defines recv() for the whole program. It differs from the C library's only for guarded descriptors,
 * and only inside tcs_guard_run(). The request handler verifies that the head passed through here (tcs_strict_heads),
 * so that a library version that reads differently is refused instead of trusted. One thread. */
#ifndef TCS_HTTP_GUARD_H
#define TCS_HTTP_GUARD_H

#include <microhttpd.h>

#include "server/http/strict.h"

typedef struct tcs_guard tcs_guard;

tcs_guard *tcs_guard_new(void);
void tcs_guard_free(tcs_guard *guard); /* NULL is fine */

/* Guards a descriptor from the start of its connection. Remove it before the descriptor is closed. */
tcs_strict *tcs_guard_add(tcs_guard *guard, int fd);
void tcs_guard_remove(tcs_guard *guard, int fd);

/* Runs MHD_run() with the guard active. */
void tcs_guard_run(tcs_guard *guard, struct MHD_Daemon *daemon);

#endif
