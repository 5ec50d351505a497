#include "renderer/raycast/gl/passes.h"

#include <epoxy/gl.h>
#include <math.h>

#include "renderer/base/clock.h"
#include "renderer/frame/frame.h"
#include "renderer/raycast/gl/slot.h"

#define BATCH_MS 7 /* expected time of a batch; two batches are queued between two polls of the halt */

double tc_gl_batch_most(const tc_gl_batch *b) { return BATCH_MS * 1e6 / b->unit_ns; }

bool tc_gl_batch_add(tc_gl_batch *b, double units, const tc_halt *halt) {
  if (b->done_ms == 0) b->done_ms = tc_now_ms();
  b->queued += units;
  if (b->queued < tc_gl_batch_most(b)) return true;
  GLsync before = b->fence;
  b->fence = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
  glFlush();
  if (before) glClientWaitSync(before, 0, (GLuint64)60e9);
  glDeleteSync(before);
  const double now = tc_now_ms();
  b->unit_ns = fmax((now - b->done_ms) * 1e6 / b->queued, 0.75 * b->unit_ns);
  b->queued = 0, b->done_ms = now;
  return !tc_halt_within(halt);
}

void tc_gl_batch_end(tc_gl_batch *b) { glDeleteSync(b->fence); }

/* Reads tiles back until the ring is idle (all), or has room. False: the GPU is lost. */
static bool read_back(const tc_gl_frame *f, bool all, GError **error) {
  tc_progress *p = f->job->frame->progress;
  const int across = (f->job->frame->width + p->side - 1) / p->side;
  while (all ? !tc_gl_ring_is_idle(f->ring) : tc_gl_ring_is_full(f->ring)) {
    const tc_gl_slot *slot = tc_gl_ring_take(f->ring, error);
    *f->lost = !slot;
    if (!slot) return false;
    tc_gl_slot_copy(slot, f->job);
    const int unit = slot->tile[1] / p->side * across + slot->tile[0] / p->side;
    p->finished[unit] = true, p->done++;
    tc_gl_ring_give(f->ring);
  }
  return true;
}

static bool draw_tile(const tc_gl_frame *f, tc_gl_tile_drawer draw, void *user, const int tile[4], GError **error) {
  if (!draw(user, tile, error) || !read_back(f, false, error)) return false;
  glUseProgram(f->programs[0]);
  tc_gl_slot_dispatch(f->ring, f->programs[0], f->job, tile);
  return true;
}

bool tc_gl_draw_tiles(const tc_gl_frame *f, tc_gl_tile_drawer draw, void *user, GError **error) {
  const tc_frame *frame = f->job->frame;
  const tc_progress *p = frame->progress;
  const int side = p->side, across = (frame->width + side - 1) / side;
  bool drawn = false, good = true;
  for (int i = 0; i < p->units && good; i++) {
    const int x = i % across * side, y = i / across * side;
    const int tile[4] = {x, y, MIN(side, frame->width - x), MIN(side, frame->height - y)};
    if (p->finished[i]) continue;
    good = drawn && tc_halt_between(f->job->halt) ? tc_halt_say(f->job->halt, error) : draw_tile(f, draw, user, tile, error);
    drawn = true;
  }
  return (*f->lost || read_back(f, true, good ? error : NULL)) && good;
}
