/* Modes that the gl back end draws in several passes instead of by rays: the interface of their drawers, and the state
 * that the back end lends them. */
#ifndef TC_RAYCAST_GL_PASSES_H
#define TC_RAYCAST_GL_PASSES_H

#include "renderer/frame/backend.h"
#include "renderer/gl/ring.h"
#include "renderer/raycast/gl/textures.h"

#define TC_GL_PASSES 4

typedef struct tc_gl_frame {
  const tc_frame_job *job;
  const unsigned *programs; /* [passes]: programs of pass 0 .. (tc_gl_variant.pass) */
  tc_gl_textures *textures; /* tc_gl_textures_begin() was called for the frame */
  tc_gl_ring *ring;         /* idle, with room for tiles of `most` pixels */
  int most;
  bool hardware;
  unsigned job_buffer;      /* the uniform block Job, filled */
  bool *lost; /* set if the GPU does not answer */
} tc_gl_frame;

typedef struct tc_gl_drawer {
  int (*passes)(const tc_scene *scene);
  /* Whether the last pass reads the volume: its texture is then in unit 0, that of its gaps in unit 4. NULL: never. */
  bool (*samples)(const tc_scene *scene);
  int (*variant)(const tc_scene *scene, int pass); /* tc_gl_variant.pass of a pass; NULL: the same number */
  const char *(*refuses)(const tc_scene *scene, bool hardware); /* a clause: why the cpu draws this scene; NULL: drawn
                                                                   here */
  bool (*draw)(const tc_gl_frame *frame, GError **error); /* contract of a back end's render(); the context is
                                                             current */
  /* Runs the passes on empty input, in the state in which draw() runs them, so that the driver finishes deferred
   * compilation. On the context's thread; of frame only programs, most and hardware are set. */
  void (*warm)(const tc_gl_frame *frame, int passes);
} tc_gl_drawer;
extern const tc_gl_drawer *const tc_gl_drawers[TC_MODE_COUNT]; /* NULL: drawn by rays */

/* Work that a frame of several passes has queued, in units of about equal time. Units with an expected time of some
 * milliseconds form a batch; before the next batch begins, the previous one is awaited and the halt is polled.
 * Initialise unit_ns, and all else to zero. */
typedef struct tc_gl_batch {
  double unit_ns, queued, done_ms;
  void *fence; /* GLsync */
} tc_gl_batch;

/* Counts units that were queued. False: the halt interrupts the frame. */
bool tc_gl_batch_add(tc_gl_batch *batch, double units, const tc_halt *halt);
/* Number of units in a batch. */
double tc_gl_batch_most(const tc_gl_batch *batch);
void tc_gl_batch_end(tc_gl_batch *batch);

/* Draws all passes but the last of one tile: x, y, width, height. False with *error set. */
typedef bool (*tc_gl_tile_drawer)(void *user, const int tile[4], GError **error);
/* Draws the unfinished tiles of the frame (tc_frame_cut()) and reads them back. */
bool tc_gl_draw_tiles(const tc_gl_frame *frame, tc_gl_tile_drawer draw, void *user, GError **error);

#endif
