/* Viewers by multipart/x-mixed-replace, for players and <img>. They cannot acknowledge: a frame counts as arrived when
 * the connection has taken all of it. I/O thread only. */
#ifndef TCS_HTTP_MJPEG_H
#define TCS_HTTP_MJPEG_H

#include "server/server.h"

struct MHD_Connection;

/* Notices viewers that left while there was nothing to send; once a second. */
void tcs_mjpeg_tick(tcs_server *server);
/* Ends every stream. */
void tcs_mjpeg_end_all(tcs_server *server);

/* The peer of a suspended connection has closed it. */
bool tcs_peer_gone(struct MHD_Connection *connection);

#endif
