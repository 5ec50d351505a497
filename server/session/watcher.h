/* A watcher: the state of one viewer of a session, that is what it has been shown and what it still needs. The
 * transport (WebSocket, MJPEG) is behind tcs_watcher_ops. Pure. I/O thread only. */
#ifndef TCS_SESSION_WATCHER_H
#define TCS_SESSION_WATCHER_H

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

#include "server/session/credit.h"
#include "server/session/view.h"

typedef struct tcs_watcher_ops {
  bool (*ready)(const tcs_watcher *watcher); /* the transport can send a frame without queueing it */
  void (*frame)(tcs_watcher *watcher, const tcs_picture *picture, const tcp_frame_header *header);
  void (*text)(tcs_watcher *watcher, const char *json);
  void (*end)(tcs_watcher *watcher); /* the session has ended: close, then call tcs_session_leave() */
  bool headers;                      /* sends headers: a picture is sent again with its error */
} tcs_watcher_ops;

struct tcs_watcher {
  const tcs_watcher_ops *ops;
  tcs_session *session; /* NULL after it left */
  uint64_t id;          /* unique in the process */
  tcs_credit credit;
  int width, height;       /* requested size, or 0 x 0: the scene's */
  tcs_view *view;          /* its pictures; NULL after it left */
  bool resized;            /* the picture it was shown last has another size */
  uint64_t seq;            /* its newest patch that is in the scene */
  uint64_t drafted_seq;    /* its newest patch in the session's draft; 0 = none */
  uint64_t others;         /* changes of the scene since it joined that are not all its own */
  uint64_t shown_revision; /* 0 = nothing shown yet */
  bool shown_final, shown_error;
};

/* Whether a picture of (`revision`, `final`) is new to the viewer. */
bool tcs_watcher_wants(const tcs_watcher *watcher, uint64_t revision, bool final);
/* Whether the viewer has seen the picture but not its measured error. */
bool tcs_watcher_wants_error(const tcs_watcher *watcher, const tcs_picture *picture);
/* The viewer's newest patch in the picture; 0 = none. */
uint64_t tcs_watcher_seq_in(const tcs_watcher *watcher, const tcs_picture *picture, uint64_t current_revision);

#endif
