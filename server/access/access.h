/* Access control: host names, page origins, tokens, tickets and share links. I/O thread only. */
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
  tcs_tokens *tokens;  /* NULL: every caller is an admin */
  unsigned generation; /* number of token files read so far, from 1 */
  tcs_lockout *lockout;
  tcs_tickets *tickets;
  uint8_t share_key[TCS_SHARE_KEY_SIZE]; /* of this process: share links end when the daemon ends, as sessions do */
  uint8_t salt[16];                      /* of this process: keys the hashes that stand for names in the log */
  int64_t refused_second;                /* last second with a refused request */
  unsigned refused;                      /* requests refused in that second */
};

/* Reads hosts, proxies and tokens as the configuration says. NULL on an error, which names the wrong option or line. */
tcs_access *tcs_access_new(const tcs_config *config, GError **error);
void tcs_access_free(tcs_access *access); /* NULL is fine */

/* The credentials of a caller. Only the peer's address is required; the others may be NULL. */
typedef struct tcs_shown {
  const char *peer, *authorization, *ticket;
} tcs_shown;

/* Identifies the caller. False: the credentials are wrong, or (*wait_s above 0) this peer presented so many wrong
 * tokens that the server did not check this one. A caller without credentials is a stranger. A server without tokens
 * treats every caller as an admin with an empty name, unless a link or a ticket grants less. */
bool tcs_access_identify(tcs_access *access, const tcs_shown *shown, tcs_caller *caller, int *wait_s);
/* Replaces the tokens after the token file was read again. Takes ownership. */
void tcs_access_renew(tcs_access *access, tcs_tokens *tokens);
/* Whether a caller's rights are still valid: its link has not expired, and its token is still in the token file. */
bool tcs_access_lasts(const tcs_access *access, tcs_caller *caller);

#endif
