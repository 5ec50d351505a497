/* Lockout of peers that present wrong tokens: after some wrong tokens a peer waits before its next token is checked,
 * longer each time. A token that the peer used before keeps working, since behind a proxy one address serves many
 * people. Pure.
 *
 * Peers and tokens are keys here: hashes that nobody outside can foresee. */
#ifndef TCS_ACCESS_LOCKOUT_H
#define TCS_ACCESS_LOCKOUT_H

#include <stdbool.h>
#include <stdint.h>

#define TCS_LOCKOUT_FREE 20    /* different wrong tokens that cost nothing */
#define TCS_LOCKOUT_MOST_S 300 /* the longest wait; each is twice the last, from 1 s */
#define TCS_LOCKOUT_FORGET_S 600
#define TCS_LOCKOUT_PEERS 1024 /* remembered; the one that was quiet the longest goes first */
#define TCS_LOCKOUT_KNOWN 4096

typedef struct tcs_lockout tcs_lockout;

tcs_lockout *tcs_lockout_new(void);
void tcs_lockout_free(tcs_lockout *lockout); /* NULL is fine */

/* A peer presented a wrong token. The same wrong token counts once; tokens that come during the wait do not count. */
void tcs_lockout_fail(tcs_lockout *lockout, uint64_t peer, uint64_t token, int64_t now_us);
/* A peer's token was right. `token` is the key of both. */
void tcs_lockout_pass(tcs_lockout *lockout, uint64_t token);
/* Seconds until a token of the peer is checked again, rounded up; 0 = now. */
int tcs_lockout_wait(const tcs_lockout *lockout, uint64_t peer, uint64_t token, int64_t now_us);

#endif
