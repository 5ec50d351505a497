#include "renderer/raycast/gl/passes.h"

#include <epoxy/gl.h>
#include <math.h>

#include "renderer/base/clock.h"
#include "renderer/frame/frame.h"
#include "renderer/raycast/gl/slot.h"

#define BATCH_MS 7 /* expected time of a batch; two are in the queue, between two looks at the halt */

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

bool tc_gl_read_back(const tc_gl_frame *f, bool all, GError **error) {
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
