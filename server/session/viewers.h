/* Viewers of a session: joining, messages, leaving. I/O thread only. */
#ifndef TCS_SESSION_VIEWERS_H
#define TCS_SESSION_VIEWERS_H

#include "server/session/session.h"

void tcs_session_join(tcs_session *session, tcs_watcher *watcher, unsigned window);
void tcs_session_leave(tcs_watcher *watcher);
/* Messages of a viewer: patch, acknowledgement, size, pointer. */
bool tcs_watcher_patch(tcs_watcher *watcher, uint64_t seq, const cJSON *patch, GError **error);
bool tcs_watcher_ack(tcs_watcher *watcher, uint64_t frame, GError **error);
/* Sets the size in pixels of this viewer's pictures; the scene and other viewers keep theirs. TC_ERROR_LIMIT. */
bool tcs_watcher_size(tcs_watcher *watcher, int64_t width, int64_t height, GError **error);
void tcs_watcher_pointer(tcs_watcher *watcher, bool down);
/* Call when the transport can send again. */
void tcs_watcher_pump(tcs_watcher *watcher);

#endif
