/* Tickets: what a WebSocket or an <img>, which cannot send a token, shows in its address instead. Each is good once,
 * for a short while, and for what its caller might do. I/O thread. */
#ifndef TCS_ACCESS_TICKETS_H
#define TCS_ACCESS_TICKETS_H

#include "server/access/role.h"

#define TCS_TICKET_S 30
#define TCS_TICKETS_EACH 64  /* not yet used, of one token or share link */
#define TCS_TICKETS_ALL 1024 /* of all */
#define TCS_TICKET_SIZE 33

typedef struct tcs_tickets tcs_tickets;

tcs_tickets *tcs_tickets_new(void);
void tcs_tickets_free(tcs_tickets *tickets); /* NULL is fine */

/* A ticket for `caller`, for the one session it is bound to if that is set. False: too many are out. */
bool tcs_tickets_issue(tcs_tickets *tickets, const tcs_caller *caller, int64_t now_us, char ticket[TCS_TICKET_SIZE]);
/* Uses a ticket up. False: there is no such ticket, or no more. */
bool tcs_tickets_take(tcs_tickets *tickets, const char *ticket, int64_t now_us, tcs_caller *caller);
/* How many are out. */
unsigned tcs_tickets_count(tcs_tickets *tickets, int64_t now_us);

#endif
