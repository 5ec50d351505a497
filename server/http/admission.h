/* Admission: the first checks of a request (host, origin, caller) and the security headers of every reply. I/O thread
 * only. */
#ifndef TCS_HTTP_ADMISSION_H
#define TCS_HTTP_ADMISSION_H

#include "server/http/http.h"

/* Checks the Host header. False: replied 421, since this server does not answer to that name. HTTP/1.0 requests may
 * omit the header: browsers never do, and other clients could send a correct one. (head.h ensures that there is at most
 * one Host, Origin and Authorization.) Call before a reply can reveal whether the path exists. */
bool tcs_admit_host(tcs_request *request);
/* Checks the Origin. False: replied 403 to a page of another origin. */
bool tcs_admit_origin(tcs_request *request);
/* Identifies the caller into request->caller. False: replied 401 (unknown), 403 (role too low) or 429 (lockout). */
bool tcs_admit_caller(tcs_request *request);
/* Adds the headers that protect a reply from being read, framed, cached or sniffed by others. Once, when the reply is
 * complete. */
void tcs_shield(tcs_request *request);

#endif
