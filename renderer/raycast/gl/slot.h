/* A tile of a frame through the read-back ring: the shader that gives its picture is dispatched, its results copied. */
#ifndef TC_RAYCAST_GL_SLOT_H
#define TC_RAYCAST_GL_SLOT_H

#include "renderer/frame/backend.h"
#include "renderer/gl/ring.h"

/* Bytes of a slot for tiles of so many pixels. */
size_t tc_gl_slot_bytes(const tc_frame_job *job, int pixels);

/* Runs the program (head.glsl) over tile x, y, width, height; the ring has room. */
void tc_gl_slot_dispatch(tc_gl_ring *ring, unsigned program, const tc_frame_job *job, const int tile[4]);

/* What a taken slot holds, into the frame. */
void tc_gl_slot_copy(const tc_gl_slot *slot, const tc_frame_job *job);

#endif
