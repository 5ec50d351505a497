/* Who may ask this server for what: names, pages, tokens. I/O thread only. */
#ifndef TCS_ACCESS_ACCESS_H
#define TCS_ACCESS_ACCESS_H

#include "server/access/hosts.h"
#include "server/server.h"

struct tcs_access {
  tcs_hosts *hosts;
};

/* Reads what the configuration names; NULL: it is wrong, and the error says where. */
tcs_access *tcs_access_new(const tcs_config *config, GError **error);
void tcs_access_free(tcs_access *access); /* NULL is fine */

#endif
