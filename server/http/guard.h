/* Puts strict.h between a connection's socket and libmicrohttpd, which reads its sockets with recv() and offers no
 * other place to look at the bytes it gets: guard.c defines that recv() for the whole program. It differs from the C
 * library's for guarded descriptors alone, and only inside tcs_guard_run(). Whoever answers a request checks that its
 * head was seen here (tcs_strict_heads), so that a library that reads in another way is refused, not trusted. One
 * thread. */
#ifndef TCS_HTTP_GUARD_H
#define TCS_HTTP_GUARD_H

#include <microhttpd.h>

#include "server/http/strict.h"

typedef struct tcs_guard tcs_guard;

tcs_guard *tcs_guard_new(void);
void tcs_guard_free(tcs_guard *guard); /* NULL is fine */

/* From the connection's start to its end, before the descriptor is closed. */
tcs_strict *tcs_guard_add(tcs_guard *guard, int fd);
void tcs_guard_remove(tcs_guard *guard, int fd);

/* MHD_run() */
void tcs_guard_run(tcs_guard *guard, struct MHD_Daemon *daemon);

#endif
