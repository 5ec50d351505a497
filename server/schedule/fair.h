/* Fair scheduling: deficit round-robin in milliseconds of render time, over classes, peers and clients.
 *
 * A client is all viewers of a session, all single renders of one peer, or all preparations of the volumes that one
 * peer loaded; a peer is whoever connects (its address, and its token if it has one). Render time is shared equally
 * between peers, and a peer's share equally between its clients, so that opening more sessions, connections or
 * requests gains nothing. Every round credits each account with a quantum; a client with a negative account waits
 * for further rounds. A slice is charged afterwards with the time it really took. Debts persist between pictures;
 * credit is capped at one quantum. Sometimes a slice takes far longer than its picture needs, because the system or
 * a hypervisor gave the processors to others. A client is therefore not charged for stalls up to a twentieth of its
 * used time: otherwise one stall would cost it as many turns as it has rivals.
 *
 * Classes are strict priorities: interactive frames, then single pictures, then refinements and preparations. To prevent
 * starvation a waiting class earns a tenth of the time spent on higher classes, and is served first once this amounts to
 * a slice.
 *
 * Pure: no clock and no threads; the caller passes the times. */
#ifndef TCS_SCHEDULE_FAIR_H
#define TCS_SCHEDULE_FAIR_H

#include <glib.h>
#include <stdbool.h>

/* Time slice when another client waits. Longer for interactive frames: most fit in one slice, and splitting them would
 * delay them all. */
#define TCS_FAIR_SLICE_MS 10.0
#define TCS_FAIR_MOVING_SLICE_MS 18.0

typedef enum tcs_class { TCS_CLASS_INTERACTIVE, TCS_CLASS_SINGLE, TCS_CLASS_REFINE, TCS_CLASS_COUNT } tcs_class;
double tcs_class_slice_ms(tcs_class class);

typedef struct tcs_fair tcs_fair;
typedef struct tcs_fair_client tcs_fair_client;

tcs_fair *tcs_fair_new(void);
void tcs_fair_free(tcs_fair *fair); /* NULL is fine; after all clients have left */

/* Adds a client of the peer named `peer` (copied). `user` is returned by tcs_fair_user(). */
tcs_fair_client *tcs_fair_join(tcs_fair *fair, const char *peer, void *user);
void tcs_fair_leave(tcs_fair_client *client); /* NULL is fine */
void *tcs_fair_user(const tcs_fair_client *client);
/* Milliseconds of render time charged so far. */
double tcs_fair_used_ms(const tcs_fair_client *client);
/* The client waits for nothing and has no debt, so that it can leave and rejoin without gain or loss. */
bool tcs_fair_even(tcs_fair_client *client);

/* Sets whether the client waits for a turn in a class. */
void tcs_fair_wait(tcs_fair_client *client, tcs_class class, bool waits);
/* Number of clients waiting in a class. */
int tcs_fair_waiting(const tcs_fair *fair, tcs_class class);

/* The next client and its class; it keeps waiting until tcs_fair_wait() says otherwise. NULL: none. accept (may be
 * NULL): whether a client may begin in this class now. */
typedef bool tcs_fair_accept(void *client_user, tcs_class class, void *user);
tcs_fair_client *tcs_fair_pick(tcs_fair *fair, tcs_fair_accept *accept, void *user, tcs_class *class);
/* Charges a slice of `ms`, of which `late_ms` exceed the expected time. */
void tcs_fair_charge(tcs_fair_client *client, tcs_class class, double ms, double late_ms);

/* How long a running client may continue, given who else waits. */
typedef enum tcs_pressure {
  TCS_PRESSURE_NONE,  /* no limit */
  TCS_PRESSURE_SLICE, /* others wait: until the end of the slice */
  TCS_PRESSURE_NOW    /* a higher class waits: pause now */
} tcs_pressure;
tcs_pressure tcs_fair_pressure(const tcs_fair *fair, const tcs_fair_client *client, tcs_class class);

#endif
