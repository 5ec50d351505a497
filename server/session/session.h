/* A session: one scene, its revisions, its viewers, and the pictures they need. I/O thread only.
 *
 * The scene is the latest-wins mailbox: the patches of a turn of the loop change it together, a render takes a snapshot
 * of what it is then.
 *
 * The files of this room, each of which may know those before it:
 *   credit     how many pictures a viewer has not acknowledged
 *   picture    a finished picture
 *   view       the pictures of one size
 *   watcher    what one viewer has been shown and still needs
 *   session    the session's state; whether it wants a picture; the label volume it holds
 *   labels_check  whether a volume looks like labels
 *   samples    how much work a picture may ask for
 *   session_scene  scenes made and checked
 *   scope      what a caller may do to a scene
 *   deliver    pictures and failures to the viewers
 *   measure    the error meter of its pictures
 *   quality_control  sampling for a bound on error or time
 *   jobs       what to render next, and what becomes of it
 *   change     the scene changes
 *   viewers    viewers come, speak and go
 *   sessions   all sessions: find, create, end, expire */
#ifndef TCS_SESSION_SESSION_H
#define TCS_SESSION_SESSION_H

#include "server/access/role.h"
#include "server/catalogue/catalogue.h"
#include "server/schedule/scheduler.h"
#include "server/session/view.h"
#include "server/session/watcher.h"

/* After this long without input a session counts as at rest and is refined to a final frame. */
#define TCS_REST_US 150000
/* A final picture that takes longer is preceded by an interactive frame, even at rest. */
#define TCS_LONG_MS 300
/* JPEG quality of interactive frames, at most. */
#define TCS_INTERACTIVE_QUALITY 75

struct tcs_session {
  tcs_server *server;
  char id[33];               /* 128 random bits, hexadecimal */
  char owner[TCS_NAME_SIZE]; /* of the token that made it; "" where there are none */
  char *peer;                /* whose render time its pictures take */
  tcs_entry *entry;          /* counted in entry->users */
  tcs_entry *labels;         /* of the scene's label volume, or NULL; counted too, unless it is `entry` itself */
  GPtrArray *meshes;         /* tcs_entry, of its surfaces: each once, and counted */
  tc_scene scene, defaults;
  tc_scene draft; /* the scene with the patches of this turn on it, where `drafted`: becomes the scene all at once */
  bool drafted;
  uint64_t revision; /* counts up from 1 with every change */
  GPtrArray *watchers;
  GPtrArray *views; /* tcs_view: one for each size that its viewers have, the scene's first */
  double build_ms;  /* smoothed: what a frame of late took for tables and skipping structures, before it was drawn */
  tc_quality_cost cost[2]; /* of its frames; the second: of lit ones in motion, which take cheaper gradients */
  tc_quality_pace pace;    /* of its frames in motion, for cost[0] */
  int64_t active_until_us; /* input flows until then */
  int64_t created_us, used_us;
  int probes;         /* rays and picks of its scene that wait or run */
  tcs_picture *still; /* newest one that was asked for by itself, without its image: what the meter says of it */
  tcs_client *client; /* the scheduler's: turns and render time */
  tcs_job *job;       /* rendering for the viewers, be it paused, or NULL; jobs being encoded are no longer here */
  GPtrArray *jobs;    /* all under way, rendering or encoding: told when the session ends */
};

/* No input flows: a final picture is wanted. */
static inline bool tcs_session_at_rest(const tcs_session *session, int64_t now_us) {
  return now_us >= session->active_until_us;
}

/* Estimated samples of the scene in a view's full size. */
double tcs_session_samples(tcs_session *session, tcs_view *view);
/* In which class some viewer waits for a picture that is not under way, or TCS_CLASS_NONE; *view, where that is not
 * NULL: in whose size. Sizes take turns. */
tcs_class tcs_session_wants(tcs_session *session, int64_t now_us, tcs_view **view);
/* The picture that is wanted in a size is a final one: no input flows, and none before it is wanted sooner. */
bool tcs_session_wants_final(tcs_session *session, tcs_view *view, int64_t now_us);
/* Something changed that a picture may be wanted for, or room for one. */
void tcs_session_wake(tcs_session *session);

/* The scene's label volume, or NULL; the session's. */
tc_volume *tcs_session_labels(const tcs_session *session);
/* After session->scene was set or changed: its label volume cannot be deleted any more, the one before can. */
void tcs_session_pin(tcs_session *session);
/* Whether an entry is its volume, its labels or one of its meshes. */
bool tcs_session_shows(const tcs_session *session, const tcs_entry *entry);
void tcs_session_unpin(tcs_session *session);

#endif
