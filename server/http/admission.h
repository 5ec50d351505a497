/* The first checks of a request: is it meant for this server, and who is asking? Also the headers that every reply
 * carries. I/O thread only. */
#ifndef TCS_HTTP_ADMISSION_H
#define TCS_HTTP_ADMISSION_H

#include "server/http/http.h"

/* False: replied 421: Host is no name of this server. (That there is one Host, one Origin and one Authorization is seen
 * to by head.h.) HTTP/1.0 may leave it out: no browser does, and others than browsers could as well send a right one.
 * Before the route is known: there is nothing at all here for others. */
bool tcs_admit_host(tcs_request *request);
/* False: replied 403: a page of another origin asks. */
bool tcs_admit_origin(tcs_request *request);
/* Who asks, into request->caller. False: replied 401 (nobody we know) or 403 (too small a role). */
bool tcs_admit_caller(tcs_request *request);
/* What keeps a reply from being read, framed, kept or guessed at by others; once, when the reply is complete. */
void tcs_shield(tcs_request *request);

#endif
