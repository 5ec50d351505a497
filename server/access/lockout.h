/* Lockout of peers that present wrong tokens: after some wrong tokens a peer waits before its next token is checked,
 * longer each time. A token that was right once from this peer keeps working, since behind a proxy one address serves
 * many people. Pure.
 *
 * Peers and tokens are given as keys: hashes that an outsider cannot predict. */
#ifndef TCS_ACCESS_LOCKOUT_H
#define TCS_ACCESS_LOCKOUT_H

#include <stdbool.h>
#include <stdint.h>

#define TCS_LOCKOUT_FREE 20    /* different wrong tokens before the first wait */
#define TCS_LOCKOUT_MOST_S 300 /* the longest wait; each wait is twice the one before, from 1 s */
#define TCS_LOCKOUT_FORGET_S 600
#define TCS_LOCKOUT_PEERS 1024 /* peers remembered; the least recently seen is replaced */
#define TCS_LOCKOUT_KNOWN 4096

typedef struct tcs_lockout tcs_lockout;

tcs_lockout *tcs_lockout_new(void);
void tcs_lockout_free(tcs_lockout *lockout); /* NULL is fine */

/* Records a wrong token of the peer. Repeats of the same wrong token count once; tokens presented during a wait do not
 * count. */
void tcs_lockout_fail(tcs_lockout *lockout, uint64_t peer, uint64_t token, int64_t now_us);
/* Records a right token. `token` is a key of peer and token together. */
void tcs_lockout_pass(tcs_lockout *lockout, uint64_t token);
/* Seconds until the next token of the peer is checked, rounded up; 0 = now. */
int tcs_lockout_wait(const tcs_lockout *lockout, uint64_t peer, uint64_t token, int64_t now_us);

#endif
