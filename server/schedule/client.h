/* A client of the renderer: an account of render time (fair.h) and a queue of jobs. I/O thread only. */
#ifndef TCS_SCHEDULE_CLIENT_H
#define TCS_SCHEDULE_CLIENT_H

#include "server/schedule/job.h"

/* For want of a class. */
#define TCS_CLASS_NONE TCS_CLASS_COUNT

typedef struct tcs_client tcs_client;

/* Makes the job that the client wants in this class, from the scene of this moment. NULL: the client wants no job of
 * this class; tcs_client_want() has said which class it wants instead. */
typedef tcs_job *tcs_client_next(void *user, tcs_class class);

/* next: NULL for one whose jobs are all submitted. */
tcs_client *tcs_client_new(tcs_fair *fair, const char *peer, tcs_client_next *next, void *user);
/* The client's queue must be empty. A job that is being rendered loses its client. */
void tcs_client_free(tcs_client *client);

/* The class in which the client wants a job. */
void tcs_client_want(tcs_client *client, tcs_class class);
void tcs_client_push(tcs_client *client, tcs_job *job);     /* to the end of the line */
void tcs_client_put_back(tcs_client *client, tcs_job *job); /* to its front */
void tcs_client_remove(tcs_client *client, tcs_job *job);
/* Its first job of the class, or one made now. NULL: none. */
tcs_job *tcs_client_take(tcs_client *client, tcs_class class);
/* The first in line if it is of the class, or NULL. */
tcs_job *tcs_client_first(const tcs_client *client, tcs_class class);
int tcs_client_length(const tcs_client *client);

void tcs_client_charge(tcs_client *client, tcs_class class, double ms, double late_ms);
double tcs_client_render_ms(const tcs_client *client);
tcs_pressure tcs_client_pressure(const tcs_client *client, tcs_class class);
/* Nothing waits and nothing is owed. */
bool tcs_client_is_even(tcs_client *client);

#endif
