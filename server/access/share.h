/* Share links: signed tokens for one session, with a role and an expiry, not stored on the server:
 * "SESSION.ROLE.SECONDS.MAC". SECONDS is the expiry on the Unix clock; the MAC covers the text before it. Pure. */
#ifndef TCS_ACCESS_SHARE_H
#define TCS_ACCESS_SHARE_H

#include "server/access/role.h"

#define TCS_SHARE_KEY_SIZE 32
#define TCS_SHARE_SIZE 160

/* Writes a link's token, which grants `role` until `until_s`. */
void tcs_share_sign(const uint8_t key[TCS_SHARE_KEY_SIZE], const char *session, tcs_role role, int64_t until_s,
                    char token[TCS_SHARE_SIZE]);
/* False: the token is not signed with this key, or has expired. */
bool tcs_share_check(const uint8_t key[TCS_SHARE_KEY_SIZE], const char *token, int64_t now_s, tcs_caller *caller);

#endif
