/* Modes that the gl back end draws in several passes instead of by rays: who draws them, and what the back end lends. */
#ifndef TC_RAYCAST_GL_PASSES_H
#define TC_RAYCAST_GL_PASSES_H

#include "renderer/frame/backend.h"
#include "renderer/gl/ring.h"
#include "renderer/raycast/gl/textures.h"

#define TC_GL_PASSES 4

typedef struct tc_gl_frame {
  const tc_frame_job *job;
  const unsigned *programs; /* [passes]: compose.h's variants of pass 0 .. */
  tc_gl_textures *textures; /* a frame of theirs has begun */
  tc_gl_ring *ring;         /* idle, with room for tiles of `most` pixels */
  int most;
  bool hardware;
  unsigned job_buffer;      /* the uniform block Job, filled */
  bool *lost; /* set where the GPU does not answer */
} tc_gl_frame;

typedef struct tc_gl_drawer {
  int (*passes)(const tc_scene *scene);
  int (*variant)(const tc_scene *scene, int pass); /* compose.h's number of a pass; NULL: its own */
  const char *(*refuses)(const tc_scene *scene, bool hardware); /* why the cpu draws this scene instead, a clause; NULL: it does not */
  bool (*draw)(const tc_gl_frame *frame, GError **error); /* as render() of a back end; the context is current */
  /* Runs the passes on nothing, in the state that draw() runs them in, so that the driver compiles what it defers; on the
   * context's thread, of frame only programs, most and hardware. */
  void (*warm)(const tc_gl_frame *frame, int passes);
} tc_gl_drawer;
extern const tc_gl_drawer *const tc_gl_drawers[TC_MODE_COUNT]; /* NULL: rays */

/* Work that such a frame has queued, in units of about equal time. Units that are expected to take some milliseconds
 * together are a batch: before the next one begins, the one before is waited for and the halt is polled. Zero but for
 * unit_ns at first. */
typedef struct tc_gl_batch {
  double unit_ns, queued, done_ms;
  void *fence; /* GLsync */
} tc_gl_batch;

/* Counts units that were queued. False: the halt interrupts the frame. */
bool tc_gl_batch_add(tc_gl_batch *batch, double units, const tc_halt *halt);
/* How many units make a batch. */
double tc_gl_batch_most(const tc_gl_batch *batch);
void tc_gl_batch_end(tc_gl_batch *batch);

/* Draws one tile, x, y, width, height, but for the last pass. False with *error set. */
typedef bool (*tc_gl_tile_drawer)(void *user, const int tile[4], GError **error);
/* Draws the tiles that the frame is cut into (tc_frame_cut()) and misses, and reads them back. */
bool tc_gl_draw_tiles(const tc_gl_frame *frame, tc_gl_tile_drawer draw, void *user, GError **error);

#endif
