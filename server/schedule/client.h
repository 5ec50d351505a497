/* A client of the renderer: an account of render time (fair.h) and a queue of jobs. I/O thread only. */
#ifndef TCS_SCHEDULE_CLIENT_H
#define TCS_SCHEDULE_CLIENT_H

#include "server/schedule/job.h"

/* no class */
#define TCS_CLASS_NONE TCS_CLASS_COUNT

typedef struct tcs_client tcs_client;

/* Makes the client's next job of this class, from the current scene. NULL: the client wants no job of this class; the
 * callback has then called tcs_client_want() with the class it does want. */
typedef tcs_job *tcs_client_next(void *user, tcs_class class);

/* next: NULL for a client whose jobs are all submitted. */
tcs_client *tcs_client_new(tcs_fair *fair, const char *peer, tcs_client_next *next, void *user);
/* The client's queue must be empty. A job that is being rendered stays, without a client. */
void tcs_client_free(tcs_client *client);

/* Sets the class of the job that the client would make next. */
void tcs_client_want(tcs_client *client, tcs_class class);
void tcs_client_push(tcs_client *client, tcs_job *job);     /* to the end of the queue */
void tcs_client_put_back(tcs_client *client, tcs_job *job); /* to the front of the queue */
void tcs_client_remove(tcs_client *client, tcs_job *job);
/* Takes the client's first job of the class, or makes one. NULL: none. */
tcs_job *tcs_client_take(tcs_client *client, tcs_class class);
/* The first job of the queue if it is of the class, else NULL. */
tcs_job *tcs_client_first(const tcs_client *client, tcs_class class);
int tcs_client_length(const tcs_client *client);

void tcs_client_charge(tcs_client *client, tcs_class class, double ms, double late_ms);
double tcs_client_render_ms(const tcs_client *client);
tcs_pressure tcs_client_pressure(const tcs_client *client, tcs_class class);
/* No job waits and the account has no debt. */
bool tcs_client_is_even(tcs_client *client);

#endif
