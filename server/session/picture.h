/* A finished picture of a session. I/O thread only. */
#ifndef TCS_SESSION_PICTURE_H
#define TCS_SESSION_PICTURE_H

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

#include "protocol/protocol.h"

typedef struct tcs_job tcs_job;

/* A finished picture, shared by viewers. Reference counted, I/O thread. */
typedef struct tcs_picture {
  int references;
  uint64_t revision;                /* of the scene it shows */
  bool final;                       /* full resolution and quality */
  tcp_frame_header header;          /* frame and seq are set per viewer */
  tc_classification classification; /* used for rendering, with `step` */
  double step;
  char shown[65];      /* storage of header.volume */
  GBytes *image;       /* NULL in a session's `still` */
  char unmeasured[96]; /* storage of header.unmeasured, if set */
  char *scene;         /* storage of header.scene */
  GArray *marks;       /* tcs_mark: each viewer's newest patch in the picture */
} tcs_picture;

typedef struct tcs_mark {
  uint64_t watcher, seq;
} tcs_mark;

/* The picture of a finished job; takes the job's marks. One reference. */
tcs_picture *tcs_picture_new(tcs_job *job);
tcs_picture *tcs_picture_ref(tcs_picture *picture);
void tcs_picture_unref(tcs_picture *picture); /* NULL is fine */
/* Whether the header has the error meter's result, or the reason for having none. */
bool tcs_picture_is_judged(const tcs_picture *picture);

#endif
