/* The read-back ring. See ring.h. */
#include "renderer/gl/ring.h"

#include <assert.h>
#include <epoxy/gl.h>
#include <string.h>

#include "renderer/gl/device.h"

#define WAIT_NS 60000000000ull /* tiles are sized to take milliseconds: a minute without an answer is a dead GPU */

static void free_slot(tc_gl_slot *slot) {
  if (slot->fence) glDeleteSync(slot->fence);
  if (slot->mapped) glUnmapNamedBuffer(slot->host);
  glDeleteBuffers(1, &slot->device);
  glDeleteBuffers(1, &slot->host);
  if (slot->clocks[0]) glDeleteQueries(2, slot->clocks);
  memset(slot, 0, sizeof *slot);
}

void tc_gl_ring_clear(tc_gl_ring *ring) {
  if (!ring->capacity) return;
  glFinish();
  for (int i = 0; i < TC_GL_RING_SLOTS; i++) free_slot(&ring->slots[i]);
  memset(ring, 0, sizeof *ring);
}

static bool make_slot(tc_gl_slot *slot, size_t capacity, bool has_clock) {
  const GLbitfield access = GL_MAP_READ_BIT | GL_MAP_PERSISTENT_BIT | GL_MAP_COHERENT_BIT;
  glCreateBuffers(1, &slot->device);
  glCreateBuffers(1, &slot->host);
  glNamedBufferStorage(slot->device, (GLsizeiptr)capacity, NULL, 0);
  /* CLIENT_STORAGE: the copy lives in host memory, where the processor reads it at full speed. */
  glNamedBufferStorage(slot->host, (GLsizeiptr)capacity, NULL, access | GL_CLIENT_STORAGE_BIT);
  slot->mapped = glMapNamedBufferRange(slot->host, 0, (GLsizeiptr)capacity, access);
  if (has_clock) glCreateQueries(GL_TIMESTAMP, 2, slot->clocks);
  return slot->mapped != NULL;
}

bool tc_gl_ring_reserve(tc_gl_ring *ring, size_t capacity, bool has_clock, GError **error) {
  assert(tc_gl_ring_is_idle(ring));
  if (ring->capacity >= capacity) return true;
  tc_gl_ring_clear(ring);
  tc_gl_forget_errors();
  ring->capacity = capacity;
  ring->has_clock = has_clock;
  bool good = true;
  for (int i = 0; i < TC_GL_RING_SLOTS && good; i++) good = make_slot(&ring->slots[i], capacity, has_clock);
  good = tc_gl_check("read-back buffers", error) && good;
  if (good) return true;
  if (error && !*error)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "gl: read-back buffers of %zu bytes cannot be mapped", capacity);
  tc_gl_ring_clear(ring);
  return false;
}

bool tc_gl_ring_is_full(const tc_gl_ring *ring) { return ring->head - ring->tail == TC_GL_RING_SLOTS; }

bool tc_gl_ring_is_idle(const tc_gl_ring *ring) { return ring->head == ring->tail; }

tc_gl_slot *tc_gl_ring_begin(tc_gl_ring *ring) {
  assert(!tc_gl_ring_is_full(ring));
  tc_gl_slot *slot = &ring->slots[ring->head % TC_GL_RING_SLOTS];
  if (ring->has_clock) glQueryCounter(slot->clocks[0], GL_TIMESTAMP);
  return slot;
}

void tc_gl_ring_end(tc_gl_ring *ring, size_t bytes) {
  tc_gl_slot *slot = &ring->slots[ring->head % TC_GL_RING_SLOTS];
  assert(bytes <= ring->capacity);
  if (ring->has_clock) glQueryCounter(slot->clocks[1], GL_TIMESTAMP);
  glMemoryBarrier(GL_BUFFER_UPDATE_BARRIER_BIT); /* shader writes before the copy reads */
  glCopyNamedBufferSubData(slot->device, slot->host, 0, 0, (GLsizeiptr)bytes);
  glMemoryBarrier(GL_CLIENT_MAPPED_BUFFER_BARRIER_BIT);
  slot->fence = glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0);
  glFlush(); /* so that the GPU starts now, not at the first wait */
  ring->head++;
}

const tc_gl_slot *tc_gl_ring_take(tc_gl_ring *ring, GError **error) {
  assert(!tc_gl_ring_is_idle(ring));
  tc_gl_slot *slot = &ring->slots[ring->tail % TC_GL_RING_SLOTS];
  GLenum state = slot->fence ? glClientWaitSync(slot->fence, GL_SYNC_FLUSH_COMMANDS_BIT, WAIT_NS) : GL_WAIT_FAILED;
  if (state == GL_ALREADY_SIGNALED || state == GL_CONDITION_SATISFIED) {
    glDeleteSync(slot->fence);
    slot->fence = NULL;
    return slot;
  }
  if (tc_gl_check("waiting for the GPU", error))
    tc_set_error(error, TC_ERROR_INTERNAL, NULL, "gl: no answer from the GPU within a minute; restart the daemon");
  return NULL;
}

double tc_gl_ring_ms(const tc_gl_ring *ring, const tc_gl_slot *slot) {
  if (!ring->has_clock) return -1;
  GLuint64 start = 0, end = 0;
  glGetQueryObjectui64v(slot->clocks[0], GL_QUERY_RESULT, &start);
  glGetQueryObjectui64v(slot->clocks[1], GL_QUERY_RESULT, &end);
  return end >= start ? (double)(end - start) * 1e-6 : -1;
}

void tc_gl_ring_give(tc_gl_ring *ring) {
  assert(!tc_gl_ring_is_idle(ring));
  ring->tail++;
}
