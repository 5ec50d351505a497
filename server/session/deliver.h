/* Delivery of a session's pictures, errors and progress to its viewers. I/O thread only. */
#ifndef TCS_SESSION_DELIVER_H
#define TCS_SESSION_DELIVER_H

#include "server/session/session.h"

/* Sends the newest picture to every viewer to whom it is new. */
void tcs_session_deliver(tcs_session *session);
void tcs_session_deliver_to(tcs_session *session, tcs_watcher *watcher, int64_t now_us);
/* Reports a failed picture to its viewers, who then wait for no other picture of that revision. */
void tcs_session_fail(tcs_session *session, const tcs_job *job);
/* Cancels the resource being built for the current picture. Its viewers get no picture of the current scene. */
void tcs_session_give_up(tcs_session *session);
typedef struct tcs_building {
  const char *stage; /* static name of the plan's stage; NULL: nothing is being built, or not for long */
  double share;      /* finished share, 0..1 */
} tcs_building;
/* Progress of the resource that the current picture waits for. */
tcs_building tcs_session_building(const tcs_session *session);
void tcs_building_write(const tcs_building *building, cJSON *json);
/* Reports that progress to the viewers of the picture. */
void tcs_session_report(tcs_session *session);
/* tcs_mark array: each viewer's newest patch in the current scene. */
GArray *tcs_session_marks(const tcs_session *session);
/* Renders the final picture again, after quality control found a better choice. */
void tcs_session_refine(tcs_session *session);

#endif
