/* A view: the pictures of a session in one size, shared by the viewers of that size. A session's first view has the
 * size of its scene. I/O thread only. */
#ifndef TCS_SESSION_VIEW_H
#define TCS_SESSION_VIEW_H

#include "server/schedule/ladder.h"
#include "server/session/picture.h"

/* Different sizes of a session's viewers at one time; further viewers get the scene's size. */
#define TCS_MOST_SIZES 6

typedef struct tcs_measure tcs_measure;
typedef struct tcs_session tcs_session;
typedef struct tcs_watcher tcs_watcher;

typedef struct tcs_view {
  int width, height;       /* 0 x 0: the scene's */
  guint watchers;          /* number of viewers */
  tcs_picture *latest;     /* newest finished picture, or NULL */
  uint64_t begun_revision; /* of the newest picture begun */
  bool begun_final;
  tcs_ladder ladders[TC_MODE_COUNT]; /* by mode: frame times of one mode do not predict another's */
  double full_samples;               /* estimated samples of the picture at full size ... */
  uint64_t samples_revision;         /* ... of this revision */
  tcs_measure *measure;              /* measurement of `latest` or of the session's `still`, or NULL */
} tcs_view;

/* The ladder of a mode, with ms_per_sample from other views as its first guess (not for slices, whose cost differs). */
tcs_ladder *tcs_view_ladder(tcs_view *view, tc_mode mode, double ms_per_sample);
tcs_view *tcs_view_new(tcs_session *session, int width, int height);
/* The view of the scene's own size: the first one. */
tcs_view *tcs_session_own_view(const tcs_session *session);
/* Assigns a viewer to the view of its size. Call after the viewer's or the scene's size changed. */
void tcs_watcher_seat(tcs_watcher *watcher);
/* Removes a viewer from a view. A view without viewers is freed, except for the first. */
void tcs_session_unseat(tcs_session *session, tcs_view *view);
void tcs_session_free_views(tcs_session *session);

/* The newest picture in any size, or NULL. */
tcs_picture *tcs_session_latest(const tcs_session *session);
/* Whether the final picture of the current scene has been started in every size with viewers. */
bool tcs_session_settled(const tcs_session *session);

#endif
