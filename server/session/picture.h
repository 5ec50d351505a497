/* A finished picture of a session. I/O thread only. */
#ifndef TCS_SESSION_PICTURE_H
#define TCS_SESSION_PICTURE_H

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

#include "protocol/protocol.h"

typedef struct tcs_job tcs_job;

/* A finished picture of a session, shared by its viewers. Reference counted, I/O thread. */
typedef struct tcs_picture {
  int references;
  uint64_t revision;                /* of the scene it shows */
  bool final;                       /* full resolution and quality */
  tcp_frame_header header;          /* frame and seq differ per viewer */
  tc_classification classification; /* it was rendered with, and at */
  double step;
  char shown[65];      /* header.volume points here */
  GBytes *image;       /* NULL in a session's `still` */
  char unmeasured[96]; /* header.unmeasured points here, or is NULL */
  char *scene;         /* header.scene points here */
  GArray *marks;       /* tcs_mark: each viewer's newest patch it shows */
} tcs_picture;

typedef struct tcs_mark {
  uint64_t watcher, seq;
} tcs_mark;

/* The picture of a finished job, whose marks it takes; one reference. */
tcs_picture *tcs_picture_new(tcs_job *job);
tcs_picture *tcs_picture_ref(tcs_picture *picture);
void tcs_picture_unref(tcs_picture *picture); /* NULL is fine */
/* Its header has what the error meter found, or why that found nothing. */
bool tcs_picture_is_judged(const tcs_picture *picture);

#endif
