/* The host names this server answers to, and the page origins that may use it: protection against DNS rebinding. A
 * browser that resolves evil.example to 127.0.0.1 still sends "Host: evil.example", and a page's requests carry its
 * Origin.
 *
 * Names compare letter by letter, case ignored; ports compare as numbers. I/O thread. */
#ifndef TCS_ACCESS_HOSTS_H
#define TCS_ACCESS_HOSTS_H

#include <stdbool.h>

#include "renderer/base/error.h"

typedef struct tcs_hosts tcs_hosts;

tcs_hosts *tcs_hosts_new(void);
void tcs_hosts_free(tcs_hosts *hosts); /* NULL is fine */

/* "NAME" (matches every port), "NAME:PORT", "[V6]:PORT". */
bool tcs_hosts_add(tcs_hosts *hosts, const char *text, GError **error);
/* "https://viewer.example": the origin of pages behind a proxy that rewrites the Host header. */
bool tcs_hosts_add_origin(tcs_hosts *hosts, const char *text, GError **error);
/* Adds the address the server listens on, such as "127.0.0.1:8080". A loopback address adds the names of localhost too;
 * "0.0.0.0" and "[::]" add every address the machine has now. */
void tcs_hosts_listen(tcs_hosts *hosts, const char *address);

/* A Host header's value. */
bool tcs_host_allowed(const tcs_hosts *hosts, const char *host);
/* Whether a page with this Origin header may send a request whose (allowed) Host header is `host`. True if the origin
 * is that host itself, another name of this server with the server's port, or a configured origin. */
bool tcs_origin_allowed(const tcs_hosts *hosts, const char *origin, const char *host);

/* Whether only this machine can reach a server that listens on this host part of --listen. True if the address does not
 * resolve. */
bool tcs_address_is_loopback(const char *address);

#endif
