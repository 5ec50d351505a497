/* Tickets: credentials in the URL of a WebSocket or an <img>, neither of which can send a token header. A ticket works
 * once, within TCS_TICKET_S seconds, with its caller's rights. I/O thread. */
#ifndef TCS_ACCESS_TICKETS_H
#define TCS_ACCESS_TICKETS_H

#include "server/access/role.h"

#define TCS_TICKET_S 30
#define TCS_TICKETS_EACH 64  /* unused tickets of one token or share link */
#define TCS_TICKETS_ALL 1024 /* unused tickets altogether */
#define TCS_TICKET_SIZE 33

typedef struct tcs_tickets tcs_tickets;

tcs_tickets *tcs_tickets_new(void);
void tcs_tickets_free(tcs_tickets *tickets); /* NULL is fine */

/* Issues a ticket with the rights of `caller`, for one session only if the caller is bound to one. False: too many
 * unused tickets, or no random numbers. */
bool tcs_tickets_issue(tcs_tickets *tickets, const tcs_caller *caller, int64_t now_us, char ticket[TCS_TICKET_SIZE]);
/* Consumes a ticket. False: unknown, used or expired ticket. */
bool tcs_tickets_take(tcs_tickets *tickets, const char *ticket, int64_t now_us, tcs_caller *caller);
/* Number of unused tickets. */
unsigned tcs_tickets_count(tcs_tickets *tickets, int64_t now_us);

#endif
