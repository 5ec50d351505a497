/* A viewer of a session: what it has been shown, what it still needs. The transport (WebSocket, MJPEG) is behind
 * tcs_watcher_ops. The decisions are pure and need no transport. I/O thread only. */
#ifndef TCS_SESSION_WATCHER_H
#define TCS_SESSION_WATCHER_H

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

#include "server/session/credit.h"
#include "server/session/view.h"

typedef struct tcs_watcher_ops {
  bool (*ready)(const tcs_watcher *watcher); /* the transport would take a frame without queueing it */
  void (*frame)(tcs_watcher *watcher, const tcs_picture *picture, const tcp_frame_header *header);
  void (*text)(tcs_watcher *watcher, const char *json);
  void (*end)(tcs_watcher *watcher); /* the session is over: close; comes back through tcs_session_leave() */
  bool headers;                      /* headers reach the viewer: a picture goes out again when its error is known */
} tcs_watcher_ops;

struct tcs_watcher {
  const tcs_watcher_ops *ops;
  tcs_session *session; /* NULL once it has left */
  uint64_t id;          /* unique in the process */
  tcs_credit credit;
  int width, height;       /* it asked for, or 0 x 0: the scene's */
  tcs_view *view;          /* whose pictures it gets; NULL once it has left */
  bool resized;            /* what it was shown had another size */
  uint64_t seq;            /* newest patch of this viewer that is in the scene */
  uint64_t drafted_seq;    /* newest one in the session's draft; 0 = none */
  uint64_t others;         /* changes of the scene since it came that are not all its own */
  uint64_t shown_revision; /* 0 = nothing yet */
  bool shown_final, shown_error;
};

/* Whether a picture of (`revision`, `final`) would tell the viewer something new. */
bool tcs_watcher_wants(const tcs_watcher *watcher, uint64_t revision, bool final);
/* Whether the viewer has seen the picture but not what the error meter made of it. */
bool tcs_watcher_wants_error(const tcs_watcher *watcher, const tcs_picture *picture);
/* The viewer's newest patch in the picture; 0 = none. */
uint64_t tcs_watcher_seq_in(const tcs_watcher *watcher, const tcs_picture *picture, uint64_t current_revision);

#endif
