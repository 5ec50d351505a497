/* Who may ask this server for what: names, pages, tokens, tickets, links. I/O thread only. */
#ifndef TCS_ACCESS_ACCESS_H
#define TCS_ACCESS_ACCESS_H

#include "server/access/hosts.h"
#include "server/access/role.h"
#include "server/access/share.h"
#include "server/access/tickets.h"
#include "server/access/tokens.h"
#include "server/server.h"

struct tcs_access {
  tcs_hosts *hosts;
  tcs_tokens *tokens; /* NULL: everybody is welcome */
  tcs_tickets *tickets;
  uint8_t share_key[TCS_SHARE_KEY_SIZE]; /* of this run: links end with it, as sessions do */
  uint8_t salt[16];                      /* of this run, for names that the log must not hold */
  int64_t refused_second;                /* the last in which somebody was turned away */
  unsigned refused;                      /* how many in it */
};

/* Reads what the configuration names; NULL: it is wrong, and the error says where. */
tcs_access *tcs_access_new(const tcs_config *config, GError **error);
void tcs_access_free(tcs_access *access); /* NULL is fine */

/* Who asks, by an Authorization header and by a ticket (either may be NULL). False: what was presented is worth
 * nothing. With nothing presented the caller is a stranger; where there are no tokens everybody is an admin of the same
 * name, unless a link or a ticket says less. */
bool tcs_access_identify(tcs_access *access, const char *authorization, const char *ticket, tcs_caller *caller);

#endif
