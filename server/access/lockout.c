#include "server/access/lockout.h"

#include <glib.h>

#define SECOND INT64_C(1000000)

typedef struct peer_state {
  uint64_t peer, token; /* token: the last wrong one */
  unsigned strikes;     /* 0: unused */
  int64_t last_us, until_us;
} peer_state;

struct tcs_lockout {
  peer_state peers[TCS_LOCKOUT_PEERS];
  uint64_t known[TCS_LOCKOUT_KNOWN]; /* indexed by key; a key overwrites another one at its index */
};

tcs_lockout *tcs_lockout_new(void) { return g_new0(tcs_lockout, 1); }
void tcs_lockout_free(tcs_lockout *lockout) { g_free(lockout); }

static peer_state *state_of(const tcs_lockout *lockout, uint64_t peer) {
  for (int i = 0; i < TCS_LOCKOUT_PEERS; i++) {
    const peer_state *state = &lockout->peers[i];
    if (state->strikes && state->peer == peer) return (peer_state *)(uintptr_t)state;
  }
  return NULL;
}

static peer_state *new_state(tcs_lockout *lockout, uint64_t peer) {
  peer_state *oldest = &lockout->peers[0];
  for (int i = 0; i < TCS_LOCKOUT_PEERS && oldest->strikes; i++)
    if (!lockout->peers[i].strikes || lockout->peers[i].last_us < oldest->last_us) oldest = &lockout->peers[i];
  *oldest = (peer_state){.peer = peer};
  return oldest;
}

void tcs_lockout_fail(tcs_lockout *lockout, uint64_t peer, uint64_t token, int64_t now_us) {
  peer_state *state = state_of(lockout, peer);
  if (!state) state = new_state(lockout, peer);
  if (state->strikes && (now_us < state->until_us || token == state->token)) return;
  if (now_us - state->last_us > TCS_LOCKOUT_FORGET_S * SECOND) state->strikes = 0;
  state->token = token;
  state->last_us = now_us;
  if (++state->strikes <= TCS_LOCKOUT_FREE) return;
  const unsigned doubled = MIN(state->strikes - TCS_LOCKOUT_FREE - 1, 16);
  state->until_us = now_us + MIN(INT64_C(1) << doubled, TCS_LOCKOUT_MOST_S) * SECOND;
}

void tcs_lockout_pass(tcs_lockout *lockout, uint64_t token) { lockout->known[token % TCS_LOCKOUT_KNOWN] = token; }

int tcs_lockout_wait(const tcs_lockout *lockout, uint64_t peer, uint64_t token, int64_t now_us) {
  const peer_state *state = state_of(lockout, peer);
  if (!state || now_us >= state->until_us || lockout->known[token % TCS_LOCKOUT_KNOWN] == token) return 0;
  return (int)((state->until_us - now_us + SECOND - 1) / SECOND);
}
