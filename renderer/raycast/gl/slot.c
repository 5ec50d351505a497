#include "renderer/raycast/gl/slot.h"

#include <epoxy/gl.h>
#include <string.h>

#include "renderer/raycast/gl/pace.h"

#define COUNTER_CELLS 64 /* head.glsl */
#define COUNTER_BYTES (COUNTER_CELLS * 32)

/* Layout of a slot: counters, picture, floats, depths. Parts start at multiples of 1024, above any driver's
 * alignment. */
typedef struct slot_layout {
  size_t picture_bytes, linear, linear_bytes, depth, depth_bytes, bytes;
} slot_layout;

static slot_layout lay_out(const tc_frame_job *job, int width, int height) {
  slot_layout l = {.picture_bytes = (size_t)width * height * 4};
  if (job->want_linear) l.linear_bytes = 4 * l.picture_bytes;
  if (job->plan->depth) l.depth_bytes = l.picture_bytes;
  l.linear = (COUNTER_BYTES + l.picture_bytes + 1023) & ~(size_t)1023;
  l.depth = (l.linear + l.linear_bytes + 1023) & ~(size_t)1023;
  l.bytes = l.depth + l.depth_bytes;
  return l;
}

size_t tc_gl_slot_bytes(const tc_frame_job *job, int pixels) { return lay_out(job, pixels, 1).bytes; }

void tc_gl_slot_dispatch(tc_gl_ring *ring, unsigned program, const tc_frame_job *job, const int tile[4]) {
  tc_gl_slot *slot = tc_gl_ring_begin(ring);
  int width = tile[2], height = tile[3];
  slot_layout l = lay_out(job, width, height);
  memcpy(slot->tile, tile, sizeof slot->tile);
  glClearNamedBufferSubData(slot->device, GL_R32UI, 0, COUNTER_BYTES, GL_RED_INTEGER, GL_UNSIGNED_INT, NULL);
  glBindBufferRange(GL_SHADER_STORAGE_BUFFER, 0, slot->device, 0, COUNTER_BYTES);
  glBindBufferRange(GL_SHADER_STORAGE_BUFFER, 1, slot->device, COUNTER_BYTES, (GLsizeiptr)l.picture_bytes);
  if (l.linear_bytes)
    glBindBufferRange(GL_SHADER_STORAGE_BUFFER, 2, slot->device, (GLintptr)l.linear, (GLsizeiptr)l.linear_bytes);
  if (l.depth_bytes)
    glBindBufferRange(GL_SHADER_STORAGE_BUFFER, 3, slot->device, (GLintptr)l.depth, (GLsizeiptr)l.depth_bytes);
  glProgramUniform4i(program, 0, tile[0], tile[1], width, height);
  glDispatchCompute((GLuint)(width + TC_GL_GROUP - 1) / TC_GL_GROUP,
                    (GLuint)(height + TC_GL_GROUP - 1) / TC_GL_GROUP, 1);
  tc_gl_ring_end(ring, l.bytes);
}

void tc_gl_slot_copy(const tc_gl_slot *slot, const tc_frame_job *job) {
  tc_frame *frame = job->frame;
  const uint8_t *bytes = slot->mapped;
  const uint32_t *counters = slot->mapped;
  int x = slot->tile[0], y = slot->tile[1], width = slot->tile[2], height = slot->tile[3];
  slot_layout l = lay_out(job, width, height);
  for (int i = 0; i < COUNTER_CELLS; i++, counters += 8) {
    frame->stats.rays += counters[0];
    frame->stats.samples += counters[1] | (uint64_t)counters[2] << 32;
    frame->stats.leaps += counters[3];
    frame->stats.gradients += counters[4] | (uint64_t)counters[5] << 32;
    frame->stats.shaded += counters[6];
  }
  for (int row = 0; row < height; row++) {
    size_t to = (size_t)(y + row) * frame->width + x, from = (size_t)row * width, pixel = 4 * sizeof(float);
    memcpy(frame->rgba + 4 * to, bytes + COUNTER_BYTES + 4 * from, (size_t)width * 4);
    if (l.linear_bytes) memcpy(frame->linear + 4 * to, bytes + l.linear + from * pixel, (size_t)width * pixel);
    if (l.depth_bytes) memcpy(frame->depth + to, bytes + l.depth + from * sizeof(float), (size_t)width * sizeof(float));
  }
}
