/* Which names this server answers to, and which pages may talk to it. A browser that was made to believe that
 * evil.example is 127.0.0.1 still says "Host: evil.example", and a page always says where it comes from.
 *
 * Names compare letter by letter, case ignored; a port is compared as a number. I/O thread. */
#ifndef TCS_ACCESS_HOSTS_H
#define TCS_ACCESS_HOSTS_H

#include <stdbool.h>

#include "renderer/base/error.h"

typedef struct tcs_hosts tcs_hosts;

tcs_hosts *tcs_hosts_new(void);
void tcs_hosts_free(tcs_hosts *hosts); /* NULL is fine */

/* "NAME" (then with every port), "NAME:PORT", "[V6]:PORT". */
bool tcs_hosts_add(tcs_hosts *hosts, const char *text, GError **error);
/* "https://viewer.example": of a proxy in front that sends on another Host than it was asked for. */
bool tcs_hosts_add_origin(tcs_hosts *hosts, const char *text, GError **error);
/* Where the server listens, as "127.0.0.1:8080": a loopback address brings the names of localhost with it, and
 * "0.0.0.0" or "[::]" every address the machine has now. */
void tcs_hosts_listen(tcs_hosts *hosts, const char *address);

/* A Host header's value. */
bool tcs_host_allowed(const tcs_hosts *hosts, const char *host);
/* An Origin header's value, of a request whose Host is `host` and allowed: that host itself, another name of this
 * server with its port, or a configured origin. */
bool tcs_origin_allowed(const tcs_hosts *hosts, const char *origin, const char *host);

/* Whether only this machine reaches what listens on the host part of --listen; true when it cannot be told. */
bool tcs_address_is_loopback(const char *address);

#endif
