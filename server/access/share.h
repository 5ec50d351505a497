/* Share links: tokens for one session, with a role and an end, signed and nowhere stored:
 * "SESSION.ROLE.SECONDS.MAC", the end in seconds of the Unix clock, the MAC over what stands before it. Pure. */
#ifndef TCS_ACCESS_SHARE_H
#define TCS_ACCESS_SHARE_H

#include "server/access/role.h"

#define TCS_SHARE_KEY_SIZE 32
#define TCS_SHARE_SIZE 160

/* The end and the role are the link's. */
void tcs_share_sign(const uint8_t key[TCS_SHARE_KEY_SIZE], const char *session, tcs_role role, int64_t until_s,
                    char token[TCS_SHARE_SIZE]);
/* False: not signed with this key, or over. */
bool tcs_share_check(const uint8_t key[TCS_SHARE_KEY_SIZE], const char *token, int64_t now_s, tcs_caller *caller);

#endif
