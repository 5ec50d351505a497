/* The pictures of a session in one size. Viewers of one size share them; the first view of a session has the size of
 * its scene. I/O thread only. */
#ifndef TCS_SESSION_VIEW_H
#define TCS_SESSION_VIEW_H

#include "server/schedule/ladder.h"
#include "server/session/picture.h"

/* Different sizes that a session's viewers may have at once; further viewers get pictures of the scene's size. */
#define TCS_MOST_SIZES 6

typedef struct tcs_measure tcs_measure;
typedef struct tcs_session tcs_session;
typedef struct tcs_watcher tcs_watcher;

typedef struct tcs_view {
  int width, height;       /* 0 x 0: the scene's */
  guint watchers;          /* how many look at it */
  tcs_picture *latest;     /* newest finished picture, or NULL */
  uint64_t begun_revision; /* of the newest picture begun */
  bool begun_final;
  tcs_ladder ladders[TC_MODE_COUNT]; /* by mode: frame times of one mode do not predict another's */
  double full_samples;               /* of its picture in full size ... */
  uint64_t samples_revision;         /* ... at this revision */
  tcs_measure *measure;              /* of `latest`, or of the session's `still`, or NULL */
} tcs_view;

/* The ladder of a mode; ms_per_sample: the time of a sample in other views, which says nothing of a slice. */
tcs_ladder *tcs_view_ladder(tcs_view *view, tc_mode mode, double ms_per_sample);
tcs_view *tcs_view_new(tcs_session *session, int width, int height);
/* The view of the scene's own size: the first one. */
tcs_view *tcs_session_own_view(const tcs_session *session);
/* Gives a viewer the view of the size it asks for, after either that or the scene's size has changed. */
void tcs_watcher_seat(tcs_watcher *watcher);
/* A viewer leaves the view, after it left the session's list of viewers or took another view. A view without viewers is
 * freed, except for the first. */
void tcs_session_unseat(tcs_session *session, tcs_view *view);
void tcs_session_free_views(tcs_session *session);

/* The newest picture in any size, or NULL. */
tcs_picture *tcs_session_latest(const tcs_session *session);
/* The final picture of the scene as it is has been begun in every size that somebody looks at. */
bool tcs_session_settled(const tcs_session *session);

#endif
