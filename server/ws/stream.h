/* WebSocket viewers: an upgraded socket, its framing, its timers, its place in a session. I/O thread only. */
#ifndef TCS_WS_STREAM_H
#define TCS_WS_STREAM_H

#include "server/session/session.h"

struct MHD_UpgradeResponseHandle;
typedef struct tcs_streams tcs_streams;

tcs_streams *tcs_streams_new(tcs_server *server);
void tcs_streams_free(tcs_streams *streams); /* after all have closed */

/* Takes over an upgraded socket: `held` are bytes that came with the handshake. When the session has ended meanwhile
 * (NULL) the socket is closed. Somebody who may only look is told so when a patch comes; when the caller's time is over
 * the stream ends. */
void tcs_streams_open(tcs_streams *streams, tcs_session *session, const tcs_caller *caller, int fd,
                      struct MHD_UpgradeResponseHandle *handle, const GByteArray *held);
int tcs_streams_count(const tcs_streams *streams);
/* Sends a text message to every viewer that keeps up. */
void tcs_streams_tell(tcs_streams *streams, const char *json);
/* Goes on reading from viewers whose messages had used up their share of the I/O thread; microseconds until the next
 * one, -1 = none waits. Call in every turn of the loop. */
int64_t tcs_streams_resume(tcs_streams *streams, int64_t now_us);
/* Pings, silences, stalled closings; call about once a second. */
void tcs_streams_tick(tcs_streams *streams, int64_t now_us);
/* Begins to close all (1001); `at_once` cuts what is left. */
void tcs_streams_close_all(tcs_streams *streams, bool at_once);
/* Frees what closed. Not from inside a callback of a stream. */
void tcs_streams_sweep(tcs_streams *streams);

#endif
