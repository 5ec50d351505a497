/* Buffers of a frame, and its progress, which a paused frame keeps until it is resumed. Private to the renderer. */
#ifndef TC_RENDERER_FRAME_H
#define TC_RENDERER_FRAME_H

#include "renderer/tomocast.h"

/* State of a unit that was paused between two rays. */
typedef struct tc_partial {
  struct tc_partial *next;
  int unit, packet, ray;
  float pixels[]; /* [side][side][4] */
} tc_partial;

#define TC_WITHIN_BYTES 76 /* per pixel of a picture with surfaces in a volume (mesh_within.c), with one layer per
                              pixel */

typedef struct tc_progress {
  bool paused;           /* may be resumed */
  int fruitless;         /* consecutive calls that were paused before they made progress */
  bool linear, depth;    /* requested outputs */
  int side, units, done; /* units: squares of side x side pixels, row by row; number of units, and of finished ones */
  uint8_t *finished;     /* [units] */
  size_t capacity;
  int64_t rays_ahead;    /* rays of the partials: progress while no unit is finished */
  tc_partial *partials;  /* a list, at most one for each worker */
  double ahead;          /* progress of the partials, in units */
  void *kept;            /* state of a paused mode that does not draw by units; NULL: none */
  size_t kept_bytes;
  void (*drop)(void *kept);
  int refined;           /* number of refinements of the mesh when the frame began */
  int tile[4];           /* next tile of a back end that draws in order: x, y, width, height */
} tc_progress;

/* Allocates the buffers of a frame of this size; with request->resume a paused frame keeps its own. */
bool tc_frame_begin(tc_frame *frame, int width, int height, const tc_render_request *request, GError **error);

/* Restarts a paused frame that began before the mesh was refined: the finished pixels show the earlier triangles. */
void tc_frame_of_mesh(tc_frame *frame, int refined);

/* Frees progress->kept. */
void tc_progress_drop(tc_progress *progress);

/* A counter that increases with every finished unit and with progress on partial ones. */
int64_t tc_frame_position(const tc_frame *frame);

/* Divides the picture into unfinished squares of side x side pixels; a resumed frame keeps its squares. NULL with
 * TC_ERROR_MEMORY. */
tc_progress *tc_frame_cut(tc_frame *frame, int side, GError **error);

#endif
