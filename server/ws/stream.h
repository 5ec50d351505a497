/* WebSocket viewers: the upgraded socket, framing, timers, and membership in a session. I/O thread only. */
#ifndef TCS_WS_STREAM_H
#define TCS_WS_STREAM_H

#include "server/session/session.h"

struct MHD_UpgradeResponseHandle;
typedef struct tcs_streams tcs_streams;

tcs_streams *tcs_streams_new(tcs_server *server);
void tcs_streams_free(tcs_streams *streams); /* after all streams have closed */

/* Takes over an upgraded socket; `held` are bytes received with the handshake. session NULL (ended meanwhile): closes
 * the socket. A caller without the right to edit gets an error for each patch. The stream ends when the caller's rights
 * end. */
void tcs_streams_open(tcs_streams *streams, tcs_session *session, const tcs_caller *caller, int fd,
                      struct MHD_UpgradeResponseHandle *handle, const GByteArray *held);
int tcs_streams_count(const tcs_streams *streams);
/* Sends a text message to every viewer whose queue is short and who may see all volumes. */
void tcs_streams_tell(tcs_streams *streams, const char *json);
/* Resumes reading from viewers that had exceeded their share of the I/O thread. Returns microseconds until the next one
 * resumes, -1 = none. Call in every turn of the loop. */
int64_t tcs_streams_resume(tcs_streams *streams, int64_t now_us);
/* Handles pings, silent peers and stalled closings; call about once a second. */
void tcs_streams_tick(tcs_streams *streams, int64_t now_us);
/* Starts closing all streams (code 1001); at_once: disconnects them. */
void tcs_streams_close_all(tcs_streams *streams, bool at_once);
/* Frees closed streams. Not from inside a callback of a stream. */
void tcs_streams_sweep(tcs_streams *streams);

#endif
