/* A session's pictures and failures to its viewers. I/O thread only. */
#ifndef TCS_SESSION_DELIVER_H
#define TCS_SESSION_DELIVER_H

#include "server/session/session.h"

/* The newest picture to every viewer that has something to learn from it. */
void tcs_session_deliver(tcs_session *session);
void tcs_session_deliver_to(tcs_session *session, tcs_watcher *watcher, int64_t now_us);
/* Tells the viewers that a picture failed; they wait for no other picture of its revision. */
void tcs_session_fail(tcs_session *session, const tcs_job *job);
/* What the picture under way waits for is given up: no picture of the scene as it is comes to those who wait for this
 * one. */
void tcs_session_give_up(tcs_session *session);
typedef struct tcs_building {
  const char *stage; /* of the plan; static. NULL: none, or none that takes long */
  double share;      /* of it that is done */
} tcs_building;
/* What the picture under way waits for. */
tcs_building tcs_session_building(const tcs_session *session);
void tcs_building_write(const tcs_building *building, cJSON *json);
/* Tells those who wait for the picture. */
void tcs_session_report(tcs_session *session);
/* tcs_mark: every viewer's newest patch in the scene as it is. */
GArray *tcs_session_marks(const tcs_session *session);
/* Renders the final picture again, since quality control now has a better choice. */
void tcs_session_refine(tcs_session *session);

#endif
