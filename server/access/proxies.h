/* The peer of a connection: its own address, or the address that a trusted proxy forwards. Everything counted by client
 * (turns, limits, wrong tokens) uses this address.
 *
 * Proxies append to X-Forwarded-For, or to Forwarded (RFC 7239). Read from the right, the first address that is not a
 * trusted proxy's is the peer; addresses left of it may be forged. Reading stops at an entry that is not an address,
 * and the peer is then the proxy that added the entry. If both headers are present and disagree, the peer is the
 * connection's own address, since the proxy wrote only one of the headers. Pure. */
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
/* Whether the forwarding headers of a connection from this address count. NULL (not an IP socket): false. */
bool tcs_proxies_trust(const tcs_proxies *proxies, const struct sockaddr *from);

/* Writes the peer's address as text; for IPv6 its /64 network, which usually is one household. "": unknown. The header
 * arguments are all lines of that header joined by commas, or NULL; they count only if `from` is trusted. */
void tcs_proxies_peer(const tcs_proxies *proxies, const struct sockaddr *from, const char *forwarded,
                      const char *x_forwarded_for, char peer[INET6_ADDRSTRLEN]);

#endif
