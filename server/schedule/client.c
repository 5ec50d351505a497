#include "server/schedule/client.h"

struct tcs_client {
  tcs_fair *fair;
  tcs_fair_client *account;
  GQueue jobs; /* tcs_job */
  tcs_class want;
  tcs_client_next *next;
  void *user;
};

/* Tells the account which classes have work: that of the first job in the queue, and that of the job to be made. */
static void tell(const tcs_client *client) {
  const tcs_job *first = g_queue_peek_head((GQueue *)&client->jobs);
  for (int i = 0; i < TCS_CLASS_COUNT; i++)
    tcs_fair_wait(client->account, (tcs_class)i,
                  (first && first->class == (tcs_class)i) || client->want == (tcs_class)i);
}

tcs_client *tcs_client_new(tcs_fair *fair, const char *peer, tcs_client_next *next, void *user) {
  tcs_client *client = g_new0(tcs_client, 1);
  *client = (tcs_client){.fair = fair, .want = TCS_CLASS_NONE, .next = next, .user = user};
  g_queue_init(&client->jobs);
  client->account = tcs_fair_join(fair, peer, client);
  return client;
}

void tcs_client_free(tcs_client *client) {
  tcs_fair_leave(client->account);
  g_queue_clear(&client->jobs);
  g_free(client);
}

void tcs_client_want(tcs_client *client, tcs_class class) {
  client->want = class;
  tell(client);
}

void tcs_client_push(tcs_client *client, tcs_job *job) {
  job->waiting = true;
  job->client = client;
  g_queue_push_tail(&client->jobs, job);
  tell(client);
}

void tcs_client_put_back(tcs_client *client, tcs_job *job) {
  job->waiting = true;
  g_queue_push_head(&client->jobs, job);
  tell(client);
}

void tcs_client_remove(tcs_client *client, tcs_job *job) {
  job->waiting = false;
  g_queue_remove(&client->jobs, job);
  tell(client);
}

tcs_job *tcs_client_first(const tcs_client *client, tcs_class class) {
  tcs_job *job = g_queue_peek_head((GQueue *)&client->jobs);
  return job && job->class == class ? job : NULL;
}

tcs_job *tcs_client_take(tcs_client *client, tcs_class class) {
  tcs_job *job = tcs_client_first(client, class);
  if (job) {
    tcs_client_remove(client, job);
  } else if (client->want == class) {
    job = client->next(client->user, class);
    if (client->want == class) client->want = TCS_CLASS_NONE; /* reset unless the callback did: ask once per turn */
    if (job) job->client = client;
    tell(client);
  }
  return job;
}

int tcs_client_length(const tcs_client *client) { return (int)client->jobs.length; }
void tcs_client_charge(tcs_client *client, tcs_class class, double ms, double late_ms) {
  tcs_fair_charge(client->account, class, ms, late_ms);
}
double tcs_client_render_ms(const tcs_client *client) { return tcs_fair_used_ms(client->account); }
bool tcs_client_is_even(tcs_client *client) { return tcs_fair_even(client->account); }

tcs_pressure tcs_client_pressure(const tcs_client *client, tcs_class class) {
  return tcs_fair_pressure(client->fair, client->account, class);
}
