/* Whose turn it is: deficit round-robin in milliseconds of render time, over classes, peers and clients.
 *
 * A client is a session's viewers together, or all single renders of one peer; a peer is whoever connects (its address,
 * and its token where it has one). Render time is shared equally between peers and a peer's share equally between its
 * clients: who opens more sessions, connections or requests gets no more of it. Every round gives each account a
 * quantum; a client whose account is below zero waits for its rounds, and what a slice took is charged afterwards,
 * whatever was expected of it. A debt outlasts a pause between two pictures; no more than a quantum is saved up.
 * Now and then a slice takes far longer than its picture needs, because the system or a hypervisor gave the processors to
 * others: a twentieth of what a client used is let off for that, or the stall would cost it as many turns as it has rivals.
 *
 * Classes come in order: what somebody drags, then single pictures, then refinements. A class that waits earns a tenth
 * of the time that goes to those before it, and is served first once that makes a slice: none starves.
 *
 * Pure: no clock and no threads, times are the caller's. */
#ifndef TCS_SCHEDULE_FAIR_H
#define TCS_SCHEDULE_FAIR_H

#include <glib.h>
#include <stdbool.h>

/* After this long a slice ends where another client waits. Longer for interactive frames: most of them are made in one,
 * and to cut those would make all of them late. */
#define TCS_FAIR_SLICE_MS 10.0
#define TCS_FAIR_MOVING_SLICE_MS 18.0

typedef enum tcs_class { TCS_CLASS_INTERACTIVE, TCS_CLASS_SINGLE, TCS_CLASS_REFINE, TCS_CLASS_COUNT } tcs_class;
double tcs_class_slice_ms(tcs_class class);

typedef struct tcs_fair tcs_fair;
typedef struct tcs_fair_client tcs_fair_client;

tcs_fair *tcs_fair_new(void);
void tcs_fair_free(tcs_fair *fair); /* NULL is fine; all clients have left */

/* A client of the peer `peer` (copied). `user` is the caller's. */
tcs_fair_client *tcs_fair_join(tcs_fair *fair, const char *peer, void *user);
void tcs_fair_leave(tcs_fair_client *client); /* NULL is fine */
void *tcs_fair_user(const tcs_fair_client *client);
/* Milliseconds charged so far. */
double tcs_fair_used_ms(const tcs_fair_client *client);
/* Nothing waits and nothing is owed: nothing is lost when it leaves and comes back. */
bool tcs_fair_even(tcs_fair_client *client);

/* Whether the client waits for a turn in a class. */
void tcs_fair_wait(tcs_fair_client *client, tcs_class class, bool waits);
/* How many clients wait in a class. */
int tcs_fair_waiting(const tcs_fair *fair, tcs_class class);

/* Who is next, and in which class; goes on waiting until told otherwise. NULL: nobody. accept: may a client begin in
 * this class now? */
typedef bool tcs_fair_accept(void *client_user, tcs_class class, void *user);
tcs_fair_client *tcs_fair_pick(tcs_fair *fair, tcs_fair_accept *accept, void *user, tcs_class *class);
/* A slice of the client's took `ms`, of which `late_ms` were more than it was thought to need. */
void tcs_fair_charge(tcs_fair_client *client, tcs_class class, double ms, double late_ms);

/* What waits beside a client that is being served. */
typedef enum tcs_pressure {
  TCS_PRESSURE_NONE,  /* go on as long as you like */
  TCS_PRESSURE_SLICE, /* others wait: give way after a slice */
  TCS_PRESSURE_NOW    /* a class before yours waits */
} tcs_pressure;
tcs_pressure tcs_fair_pressure(const tcs_fair *fair, const tcs_fair_client *client, tcs_class class);

#endif
