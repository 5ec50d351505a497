/* Who may ask this server for what: names, pages, tokens, tickets, links. I/O thread only. */
#ifndef TCS_ACCESS_ACCESS_H
#define TCS_ACCESS_ACCESS_H

#include "server/access/hosts.h"
#include "server/access/lockout.h"
#include "server/access/proxies.h"
#include "server/access/role.h"
#include "server/access/share.h"
#include "server/access/tickets.h"
#include "server/access/tokens.h"
#include "server/server.h"

struct tcs_access {
  tcs_hosts *hosts;
  tcs_proxies *proxies;
  tcs_tokens *tokens;  /* NULL: everybody is welcome */
  unsigned generation; /* of the tokens: counts up from 1 with each file that was read */
  tcs_lockout *lockout;
  tcs_tickets *tickets;
  uint8_t share_key[TCS_SHARE_KEY_SIZE]; /* of this run: links end with it, as sessions do */
  uint8_t salt[16];                      /* of this run, for names that the log must not hold */
  int64_t refused_second;                /* the last in which somebody was turned away */
  unsigned refused;                      /* how many in it */
};

/* Reads what the configuration names; NULL: it is wrong, and the error says where. */
tcs_access *tcs_access_new(const tcs_config *config, GError **error);
void tcs_access_free(tcs_access *access); /* NULL is fine */

/* The credentials of a caller; each may be NULL but the peer's address. */
typedef struct tcs_shown {
  const char *peer, *authorization, *ticket;
} tcs_shown;

/* Finds out who asks. False: the credentials are wrong, or (*wait_s above 0) this peer presented so many wrong ones
 * that they were not checked. A caller without credentials is a stranger. A server without tokens takes every caller
 * for an admin of one name, unless a link or a ticket grants less. */
bool tcs_access_identify(tcs_access *access, const tcs_shown *shown, tcs_caller *caller, int *wait_s);
/* Takes the tokens of a file that was read again. */
void tcs_access_renew(tcs_access *access, tcs_tokens *tokens);
/* Whether a caller may still do what it might when it came: its link has not expired, its token is still one. */
bool tcs_access_lasts(const tcs_access *access, tcs_caller *caller);

#endif
