/* The peer of a connection: its address, or the address that a trusted proxy forwards. Everything that is counted by
 * client (turns, limits, wrong tokens) uses this one answer.
 *
 * Proxies append to X-Forwarded-For, or to Forwarded (RFC 7239): read from the right, the first address that is no
 * trusted proxy's is the peer; addresses left of it may be forged. An entry that is no address ends the reading, and
 * the peer is then the proxy that passed it on. The same holds where both headers are present and disagree, since the
 * proxy wrote only one of them. Pure. */
#ifndef TCS_ACCESS_PROXIES_H
#define TCS_ACCESS_PROXIES_H

#include <netinet/in.h>
#include <stdbool.h>
#include <sys/socket.h>

#include "renderer/base/error.h"

typedef struct tcs_proxies tcs_proxies;

tcs_proxies *tcs_proxies_new(void);
void tcs_proxies_free(tcs_proxies *proxies); /* NULL is fine */
/* "ADDR" or "ADDR/BITS", of IPv4 or IPv6. */
bool tcs_proxies_add(tcs_proxies *proxies, const char *text, GError **error);
/* Whether the headers of a connection from there count. NULL: another kind of socket. */
bool tcs_proxies_trust(const tcs_proxies *proxies, const struct sockaddr *from);

/* The peer's address as text; of IPv6 its network of 64 bits, which is one household's. "": not known. The headers'
 * lines each joined by commas, or NULL; they count only if `from` is trusted. */
void tcs_proxies_peer(const tcs_proxies *proxies, const struct sockaddr *from, const char *forwarded,
                      const char *x_forwarded_for, char peer[INET6_ADDRSTRLEN]);

#endif
