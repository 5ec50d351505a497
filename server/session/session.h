/* Sessions: one scene each, its revisions, its viewers, and the pictures they need. I/O thread only.
 *
 * The scene is the latest-wins mailbox: a patch changes it at once, a render takes a snapshot of what it is then. */
#ifndef TCS_SESSION_SESSION_H
#define TCS_SESSION_SESSION_H

#include "server/catalogue/catalogue.h"
#include "server/schedule/ladder.h"
#include "server/schedule/scheduler.h"
#include "server/session/watcher.h"

/* After this long without input a session counts as at rest and is refined to a final frame. */
#define TCS_REST_US 150000
/* JPEG quality of interactive frames, at most. */
#define TCS_INTERACTIVE_QUALITY 75

typedef struct tcs_measure tcs_measure;

struct tcs_session {
  tcs_server *server;
  char id[33];      /* 128 random bits, hexadecimal */
  tcs_entry *entry; /* counted in entry->users */
  tcs_entry *labels; /* of the scene's label volume, or NULL; counted too, unless it is `entry` itself */
  tc_scene scene, defaults;
  uint64_t revision; /* counts up from 1 with every change */
  GPtrArray *watchers;
  tcs_ladder ladder;
  tc_quality_cost cost; /* of its frames */
  int64_t active_until_us; /* input flows until then */
  int64_t created_us, used_us;
  tcs_picture *latest;     /* newest finished picture, or NULL */
  tcs_picture *still;      /* newest one that was asked for by itself, without its image: what the meter says of it */
  tcs_job *job;            /* rendering for the viewers, or NULL; jobs being encoded are no longer here */
  uint64_t begun_revision; /* of the newest picture begun */
  bool begun_final;
  tcs_measure *measure; /* of `latest` or `still`, or NULL */
  GPtrArray *jobs; /* all under way, rendering or encoding: told when the session ends */
};

tcs_sessions *tcs_sessions_new(tcs_server *server);
void tcs_sessions_free(tcs_sessions *sessions);
tcs_session *tcs_sessions_find(tcs_sessions *sessions, const char *id);
int tcs_sessions_count(const tcs_sessions *sessions);
/* Calls `each` for every session, oldest first. */
void tcs_sessions_each(tcs_sessions *sessions, void (*each)(tcs_session *session, void *user), void *user);

/* A session on a resident volume with the volume's default scene and `patch` (may be NULL) on top. TC_ERROR_BUSY when
 * there are too many; else the errors of a scene. */
tcs_session *tcs_sessions_create(tcs_sessions *sessions, tcs_entry *entry, const cJSON *patch, GError **error);
void tcs_session_end(tcs_session *session);
/* The scene's label volume, or NULL; the session's. */
tc_volume *tcs_session_labels(const tcs_session *session);
/* After session->scene was set or changed: its label volume cannot be deleted any more, the one before can. */
void tcs_session_pin(tcs_session *session);
/* Ends every session that shows a volume, be it as labels. */
void tcs_sessions_end_of(tcs_sessions *sessions, const tcs_entry *entry);

/* Checks a scene against the limits and what the renderer can do, and finds its label volume (NULL when it has none;
 * the catalogue's). */
bool tcs_scene_check(tcs_server *server, const tc_volume *volume, const tc_scene *scene, tc_volume **labels,
                     GError **error);
/* The defaults for a volume, with `patch` (may be NULL) on top. *scene holds nothing before, nor after a failure. */
/* What this version answers with TC_ERROR_UNSUPPORTED: values by the dotted path of their member. Any thread. */
cJSON *tcs_unavailable(void);

bool tcs_scene_make(tcs_server *server, const tc_volume *volume, const cJSON *patch, tc_scene *scene, GError **error);

/* Merge patch onto the scene, or onto the defaults when `whole`. On failure the scene stays. */
bool tcs_session_patch(tcs_session *session, const cJSON *patch, bool whole, GError **error);

/* After session->scene was changed: counts the revision, cancels a refinement of the old scene, wakes the viewers. */
void tcs_session_changed(tcs_session *session);

/* Makes the final picture of the scene as it is once more: more is known of its quality. */
void tcs_session_refine(tcs_session *session);
/* How many pixels of a job's picture the meter is to have: the scene's wish, 0 where there is no reference. */
int tcs_meter_pixels(const tcs_job *job);
/* A final picture was made for one who asked for it alone: it is measured where no viewer's picture is. */
void tcs_session_still(tcs_session *session, tcs_job *job);
/* What the meter found of the scene as it is, or why nothing; NULL: not known, or not asked. The session's. */
const tcs_picture *tcs_session_judged(const tcs_session *session);
/* The newest picture to every viewer that has something to learn from it. */
void tcs_session_deliver(tcs_session *session);

/* Viewers. */
void tcs_session_join(tcs_session *session, tcs_watcher *watcher, unsigned window);
void tcs_session_leave(tcs_watcher *watcher);
/* A patch, an acknowledgement, a pointer of a viewer. */
bool tcs_watcher_patch(tcs_watcher *watcher, uint64_t seq, const cJSON *patch, GError **error);
bool tcs_watcher_ack(tcs_watcher *watcher, uint64_t frame, GError **error);
void tcs_watcher_pointer(tcs_watcher *watcher, bool down);
/* The transport can take frames again. */
void tcs_watcher_pump(tcs_watcher *watcher);

/* Microseconds until a session comes to rest or may be retried; -1 = nothing to wait for. */
int64_t tcs_sessions_next_us(const tcs_sessions *sessions, int64_t now_us);
/* Once a second: ends sessions that nobody used for the configured time. */
void tcs_sessions_expire(tcs_sessions *sessions, int64_t now_us);

#endif
