/* MJPEG viewers (multipart/x-mixed-replace), for players and <img>. They cannot acknowledge frames: a frame counts as
 * acknowledged when it was written to the connection completely. I/O thread only. */
#ifndef TCS_HTTP_MJPEG_H
#define TCS_HTTP_MJPEG_H

#include "server/server.h"

struct MHD_Connection;

/* Once a second: detects viewers that left while there was nothing to send. */
void tcs_mjpeg_tick(tcs_server *server);
/* Ends every stream. */
void tcs_mjpeg_end_all(tcs_server *server);

/* Whether the peer of a suspended connection has closed it. */
bool tcs_peer_gone(struct MHD_Connection *connection);

#endif
