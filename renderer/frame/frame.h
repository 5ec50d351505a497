/* A frame's memory, and how far it is drawn: what a paused one keeps until it is resumed. Private to the renderer. */
#ifndef TC_RENDERER_FRAME_H
#define TC_RENDERER_FRAME_H

#include "renderer/tomocast.h"

/* A unit that was left between two rays: what it needs to be gone on with. */
typedef struct tc_partial {
  struct tc_partial *next;
  int unit, packet, ray;
  float pixels[]; /* [side][side][4] */
} tc_partial;

#define TC_WITHIN_BYTES 76 /* of a pixel with surfaces in a volume (mesh_within.c): its own, and the part's picture */

typedef struct tc_progress {
  bool paused;           /* to be gone on with */
  int fruitless;         /* calls in a row that were paused before they came any further */
  bool linear, depth;    /* were asked for */
  int side, units, done; /* squares of side pixels, row by row; how many of them are finished */
  uint8_t *finished;     /* [units] */
  size_t capacity;
  int64_t rays_ahead;    /* of the partials: it grows while no unit is finished */
  tc_partial *partials;  /* a list: as many as there are workers, at most */
  double ahead;          /* share of a unit that is done of others */
  void *kept;            /* of a mode that draws no squares, while it is paused; NULL: nothing */
  size_t kept_bytes;
  void (*drop)(void *kept);
  int refined;           /* the mesh's, as the frame began */
  int tile[4];           /* of a back end that draws in order: x, y, width, height of the next */
} tc_progress;

/* Buffers for a frame of this size; with resume, of a paused one as it is. */
bool tc_frame_begin(tc_frame *frame, int width, int height, const tc_render_request *request, GError **error);

/* Of a mesh that is refined so many times: one that was begun with another is begun anew, for its parts would not fit. */
void tc_frame_of_mesh(tc_frame *frame, int refined);

/* Frees what is kept. */
void tc_progress_drop(tc_progress *progress);

/* Grows with every unit that is finished, and with what is done of others. */
int64_t tc_frame_position(const tc_frame *frame);

/* Cuts the picture into squares of side pixels, none of them finished; a resumed one stays as it was cut. NULL with
 * TC_ERROR_MEMORY. */
tc_progress *tc_frame_cut(tc_frame *frame, int side, GError **error);

#endif
