#include "server/access/tickets.h"

#include <glib.h>
#include <string.h>

#include "server/access/secret.h"

typedef struct entry {
  uint8_t hash[TCS_HASH_SIZE]; /* of the ticket */
  tcs_caller caller;
  int64_t until_us;
} entry;

struct tcs_tickets {
  GArray *out; /* entry, oldest first */
};

tcs_tickets *tcs_tickets_new(void) {
  tcs_tickets *tickets = g_new0(tcs_tickets, 1);
  tickets->out = g_array_new(FALSE, FALSE, sizeof(entry));
  return tickets;
}

void tcs_tickets_free(tcs_tickets *tickets) {
  if (!tickets) return;
  g_array_unref(tickets->out);
  g_free(tickets);
}

static void sweep(tcs_tickets *tickets, int64_t now_us) {
  guint old = 0; /* all tickets live equally long, so the oldest expires first */
  while (old < tickets->out->len && g_array_index(tickets->out, entry, old).until_us <= now_us) old++;
  if (old) g_array_remove_range(tickets->out, 0, old);
}

bool tcs_tickets_issue(tcs_tickets *tickets, const tcs_caller *caller, int64_t now_us, char ticket[TCS_TICKET_SIZE]) {
  uint8_t random[(TCS_TICKET_SIZE - 1) / 2];
  unsigned own = 0;
  sweep(tickets, now_us);
  for (guint i = 0; i < tickets->out->len; i++)
    own += strcmp(g_array_index(tickets->out, entry, i).caller.name, caller->name) == 0;
  if (own >= TCS_TICKETS_EACH || tickets->out->len >= TCS_TICKETS_ALL || !tcs_random(random, sizeof random))
    return false;
  entry fresh = {.caller = *caller, .until_us = now_us + TCS_TICKET_S * INT64_C(1000000)};
  tcs_hex(random, sizeof random, ticket);
  tcs_hash(ticket, fresh.hash);
  g_array_append_val(tickets->out, fresh);
  return true;
}

bool tcs_tickets_take(tcs_tickets *tickets, const char *ticket, int64_t now_us, tcs_caller *caller) {
  uint8_t hash[TCS_HASH_SIZE];
  tcs_hash(ticket, hash);
  sweep(tickets, now_us);
  guint found = tickets->out->len;
  for (guint i = 0; i < tickets->out->len; i++)
    if (tcs_hash_equal(g_array_index(tickets->out, entry, i).hash, hash)) found = i;
  if (found == tickets->out->len) return false;
  *caller = g_array_index(tickets->out, entry, found).caller;
  g_array_remove_index(tickets->out, found);
  return true;
}

unsigned tcs_tickets_count(tcs_tickets *tickets, int64_t now_us) {
  sweep(tickets, now_us);
  return tickets->out->len;
}
