/* A session: one scene, its revisions, its viewers, and their pictures. I/O thread only.
 *
 * The scene is a latest-wins mailbox: all patches of a turn of the loop change it together, and a render takes a
 * snapshot.
 *
 * The files of this folder; each may include those before it:
 *   credit     flow control of a viewer
 *   picture    a finished picture
 *   view       the pictures of one size
 *   watcher    what a viewer has been shown and still needs
 *   session    state of a session; the picture it needs next; references to labels and meshes
 *   labels_check  whether a volume looks like labels
 *   samples    limits on the work of a picture
 *   session_scene  scenes made and checked
 *   scope      permissions of a caller on a scene
 *   deliver    pictures and errors to the viewers
 *   measure    the error meter
 *   quality_control  sampling for a bound on error or time
 *   jobs       the next picture to render, and the delivery of a finished one
 *   change     changes of the scene
 *   viewers    viewers join, send messages and leave
 *   sessions   all sessions: find, create, end, expire */
#ifndef TCS_SESSION_SESSION_H
#define TCS_SESSION_SESSION_H

#include "server/access/role.h"
#include "server/catalogue/catalogue.h"
#include "server/schedule/scheduler.h"
#include "server/session/view.h"
#include "server/session/watcher.h"

/* After this long without input a session is at rest and gets a final picture. */
#define TCS_REST_US 150000
/* A final picture expected to take longer is preceded by an interactive frame, even at rest. */
#define TCS_LONG_MS 300
/* Highest JPEG quality of interactive frames. */
#define TCS_INTERACTIVE_QUALITY 75

struct tcs_session {
  tcs_server *server;
  char id[33];               /* 128 random bits, hexadecimal */
  char owner[TCS_NAME_SIZE]; /* name of the creator's token; "" on a server without tokens */
  char *peer;                /* peer charged for its render time */
  tcs_entry *entry;          /* the volume; counted in entry->users */
  tcs_entry *labels;         /* entry of the scene's label volume, or NULL; counted unless it is `entry` */
  GPtrArray *meshes;         /* tcs_entry of the scene's surfaces, each once and counted */
  tc_scene scene, defaults;
  tc_scene draft; /* if `drafted`: the scene with the patches of this turn */
  bool drafted;
  uint64_t revision; /* counts up from 1 with every change */
  GPtrArray *watchers;
  GPtrArray *views;        /* tcs_view, one per size in use; the first has the scene's size */
  double build_ms;         /* smoothed time that recent frames spent building tables and skipping structures */
  tc_quality_cost cost[2]; /* of this session's frames; [1]: lit frames in motion, whose gradients are cheaper */
  tc_quality_pace pace;    /* of frames in motion, relative to cost[0] */
  int64_t active_until_us; /* at rest from then on */
  int64_t created_us, used_us;
  int probes;         /* rays and picks of the scene, waiting or running */
  tcs_picture *still; /* newest picture of a single request, without its image, for the meter's result */
  tcs_client *client; /* in the scheduler */
  tcs_job *job;       /* being rendered or paused, or NULL; not while it is encoded */
  GPtrArray *jobs;    /* all jobs, rendering or encoding: notified when the session ends */
};

/* No input for TCS_REST_US: a final picture is due. */
static inline bool tcs_session_at_rest(const tcs_session *session, int64_t now_us) {
  return now_us >= session->active_until_us;
}

/* Estimated samples of the scene at the view's size. */
double tcs_session_samples(tcs_session *session, tcs_view *view);
/* The class of the next picture that some viewer waits for, or TCS_CLASS_NONE; *view (may be NULL): its size. Sizes
 * take turns. */
tcs_class tcs_session_wants(tcs_session *session, int64_t now_us, tcs_view **view);
/* Whether the next picture of the view is a final one: the session is at rest, and no preview is needed first. */
bool tcs_session_wants_final(tcs_session *session, tcs_view *view, int64_t now_us);
/* Call after a change that may require or allow another picture. */
void tcs_session_wake(tcs_session *session);

/* The scene's label volume, or NULL; owned by the session. */
tc_volume *tcs_session_labels(const tcs_session *session);
/* After session->scene was set or changed: marks its label volume and meshes as used, and releases the previous ones.
 */
void tcs_session_pin(tcs_session *session);
/* Whether an entry is the session's volume, labels or one of its meshes. */
bool tcs_session_shows(const tcs_session *session, const tcs_entry *entry);
void tcs_session_unpin(tcs_session *session);

#endif
