#include "server/schedule/fair.h"

#include <math.h>
#include <stdint.h>

#define QUANTUM_MS 4.0
#define SHARE 0.1           /* of the time spent on higher classes, earned by a waiting class */
#define MOST_EARNED_MS 20.0 /* cap, so that a class that waited long gets no long uninterrupted turn */
#define GRACE 0.05          /* of a client's used time, not charged for late slices */
#define MOST_GRACE_MS 50.0

/* Account of a peer among all peers, or of a client among its peer's clients. */
typedef struct account {
  double deficit_ms; /* may start a slice from 0 on */
  uint64_t seen;     /* rounds of its ring already credited */
  uint64_t since;    /* order of waiting: the smallest waited longest */
  int waiting[TCS_CLASS_COUNT];
} account;

typedef struct ring {
  GPtrArray *members; /* pointers to structs that begin with an account */
  uint64_t rounds;
} ring;

typedef struct peer {
  account account;
  tcs_fair *fair;
  char *name;
  ring clients;
} peer;

struct tcs_fair_client {
  account account;
  peer *peer;
  void *user;
  double used_ms, grace_ms;
};

struct tcs_fair {
  ring peers;
  GHashTable *by_name;
  uint64_t turns;
  int waiting[TCS_CLASS_COUNT];
  double earned_ms[TCS_CLASS_COUNT];
};

double tcs_class_slice_ms(tcs_class class) {
  return class == TCS_CLASS_INTERACTIVE ? TCS_FAIR_MOVING_SLICE_MS : TCS_FAIR_SLICE_MS;
}

/* ---- accounts and rounds ---- */

static bool waits(const account *a) {
  for (int i = 0; i < TCS_CLASS_COUNT; i++)
    if (a->waiting[i]) return true;
  return false;
}

/* Credits the rounds since the last call. Credit is capped at one quantum. */
static void settle(const ring *r, account *a) {
  a->deficit_ms = fmin(QUANTUM_MS, a->deficit_ms + QUANTUM_MS * (double)(r->rounds - a->seen));
  a->seen = r->rounds;
}

static double rounds_owed(const account *a) { return ceil(fmax(0, -a->deficit_ms) / QUANTUM_MS); }

/* A new account starts with the debt of one slice, so that leaving and rejoining is no way to the front. */
static void enter(ring *r, account *a) {
  a->deficit_ms = -TCS_FAIR_SLICE_MS;
  a->seen = r->rounds;
  g_ptr_array_add(r->members, a);
}

static bool before(const account *a, const account *b) {
  if (!b) return true;
  const double owed = rounds_owed(a), other = rounds_owed(b);
  return owed < other || (owed == other && a->since < b->since);
}

/* Advances the ring until the picked account has no debt. */
static void turn(ring *r, account *a, uint64_t now) {
  r->rounds += (uint64_t)rounds_owed(a);
  settle(r, a);
  a->since = now;
}

static void set_waiting(tcs_fair *fair, const ring *r, account *a, tcs_class class, int change) {
  settle(r, a);
  if (!waits(a)) a->since = ++fair->turns;
  a->waiting[class] += change;
}

/* ---- peers and clients ---- */

tcs_fair *tcs_fair_new(void) {
  tcs_fair *fair = g_new0(tcs_fair, 1);
  fair->peers.members = g_ptr_array_new();
  fair->by_name = g_hash_table_new(g_str_hash, g_str_equal);
  return fair;
}

static void free_peer(peer *p) {
  g_hash_table_remove(p->fair->by_name, p->name);
  g_ptr_array_remove(p->fair->peers.members, p);
  g_ptr_array_unref(p->clients.members);
  g_free(p->name);
  g_free(p);
}

/* A peer without clients is kept while it has debt, so that ending a session and opening another does not clear it. */
static void forget_even_peers(tcs_fair *fair) {
  for (guint i = fair->peers.members->len; i-- > 0;) {
    peer *p = g_ptr_array_index(fair->peers.members, i);
    if (p->clients.members->len) continue;
    settle(&fair->peers, &p->account);
    if (p->account.deficit_ms >= 0 || fair->peers.members->len == 1) free_peer(p);
  }
}

void tcs_fair_free(tcs_fair *fair) {
  if (!fair) return;
  while (fair->peers.members->len) free_peer(g_ptr_array_index(fair->peers.members, 0));
  g_ptr_array_unref(fair->peers.members);
  g_hash_table_destroy(fair->by_name);
  g_free(fair);
}

static peer *peer_called(tcs_fair *fair, const char *name) {
  peer *p = g_hash_table_lookup(fair->by_name, name);
  if (p) return p;
  p = g_new0(peer, 1);
  p->fair = fair;
  p->name = g_strdup(name);
  p->clients.members = g_ptr_array_new();
  enter(&fair->peers, &p->account);
  g_hash_table_insert(fair->by_name, p->name, p);
  return p;
}

tcs_fair_client *tcs_fair_join(tcs_fair *fair, const char *peer_name, void *user) {
  forget_even_peers(fair);
  tcs_fair_client *client = g_new0(tcs_fair_client, 1);
  client->peer = peer_called(fair, peer_name);
  client->user = user;
  enter(&client->peer->clients, &client->account);
  return client;
}

void tcs_fair_leave(tcs_fair_client *client) {
  if (!client) return;
  for (int i = 0; i < TCS_CLASS_COUNT; i++) tcs_fair_wait(client, (tcs_class)i, false);
  g_ptr_array_remove(client->peer->clients.members, client);
  g_free(client);
}

void *tcs_fair_user(const tcs_fair_client *client) { return client->user; }
double tcs_fair_used_ms(const tcs_fair_client *client) { return client->used_ms; }

bool tcs_fair_even(tcs_fair_client *client) {
  const bool last = client->peer->clients.members->len == 1;
  settle(&client->peer->clients, &client->account);
  return !waits(&client->account) && (last || client->account.deficit_ms >= 0);
}

/* ---- turns ---- */

void tcs_fair_wait(tcs_fair_client *client, tcs_class class, bool waiting) {
  tcs_fair *fair = client->peer->fair;
  const int change = (int)waiting - client->account.waiting[class];
  if (!change) return;
  set_waiting(fair, &client->peer->clients, &client->account, class, change);
  set_waiting(fair, &fair->peers, &client->peer->account, class, change);
  fair->waiting[class] += change;
  if (!fair->waiting[class]) fair->earned_ms[class] = 0;
}

int tcs_fair_waiting(const tcs_fair *fair, tcs_class class) { return fair->waiting[class]; }

typedef struct question {
  tcs_fair_accept *accept;
  void *user;
  tcs_class class;
} question;

static tcs_fair_client *first_of(const peer *p, const question *q) {
  tcs_fair_client *found = NULL;
  for (guint i = 0; i < p->clients.members->len; i++) {
    tcs_fair_client *client = g_ptr_array_index(p->clients.members, i);
    if (!client->account.waiting[q->class]) continue;
    settle(&p->clients, &client->account);
    if (before(&client->account, found ? &found->account : NULL) &&
        (!q->accept || q->accept(client->user, q->class, q->user)))
      found = client;
  }
  return found;
}

static tcs_fair_client *pick_in(tcs_fair *fair, const question *q) {
  tcs_fair_client *found = NULL;
  for (guint i = 0; fair->waiting[q->class] && i < fair->peers.members->len; i++) {
    peer *p = g_ptr_array_index(fair->peers.members, i);
    if (!p->account.waiting[q->class]) continue;
    settle(&fair->peers, &p->account);
    if (!before(&p->account, found ? &found->peer->account : NULL)) continue;
    tcs_fair_client *client = first_of(p, q);
    if (client) found = client;
  }
  if (!found) return NULL;
  turn(&fair->peers, &found->peer->account, ++fair->turns);
  turn(&found->peer->clients, &found->account, fair->turns);
  return found;
}

tcs_fair_client *tcs_fair_pick(tcs_fair *fair, tcs_fair_accept *accept, void *user, tcs_class *class) {
  for (int pass = 0; pass < 2; pass++) {
    for (int i = 0; i < TCS_CLASS_COUNT; i++) {
      if (pass == 0 && fair->earned_ms[i] < TCS_FAIR_SLICE_MS) continue;
      const question q = {accept, user, (tcs_class)i};
      tcs_fair_client *client = pick_in(fair, &q);
      if (!client) continue;
      *class = q.class;
      return client;
    }
  }
  return NULL;
}

void tcs_fair_charge(tcs_fair_client *client, tcs_class class, double ms, double late_ms) {
  tcs_fair *fair = client->peer->fair;
  const double let_off_ms = fmin(late_ms, client->grace_ms);
  client->grace_ms = fmin(MOST_GRACE_MS, client->grace_ms - let_off_ms + GRACE * ms);
  client->used_ms += ms;
  client->account.deficit_ms -= ms - let_off_ms;
  client->peer->account.deficit_ms -= ms - let_off_ms;
  fair->earned_ms[class] = fmax(0, fair->earned_ms[class] - ms);
  for (int i = (int)class + 1; i < TCS_CLASS_COUNT; i++)
    if (fair->waiting[i]) fair->earned_ms[i] = fmin(MOST_EARNED_MS, fair->earned_ms[i] + SHARE * ms);
}

tcs_pressure tcs_fair_pressure(const tcs_fair *fair, const tcs_fair_client *client, tcs_class class) {
  tcs_pressure pressure = TCS_PRESSURE_NONE;
  for (int i = 0; i < TCS_CLASS_COUNT; i++) {
    const int others = fair->waiting[i] - client->account.waiting[i];
    if (fair->waiting[i] && i < (int)class) return TCS_PRESSURE_NOW;
    if (others) pressure = TCS_PRESSURE_SLICE;
  }
  return pressure;
}
