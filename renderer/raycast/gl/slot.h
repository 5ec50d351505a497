/* Tiles of a frame in the read-back ring: dispatches the shader that writes a tile, and copies its results. */
#ifndef TC_RAYCAST_GL_SLOT_H
#define TC_RAYCAST_GL_SLOT_H

#include "renderer/frame/backend.h"
#include "renderer/gl/ring.h"

/* Bytes of a slot for a tile of `pixels` pixels. */
size_t tc_gl_slot_bytes(const tc_frame_job *job, int pixels);

/* Dispatches the program (head.glsl) for the tile x, y, width, height; the ring must not be full. */
void tc_gl_slot_dispatch(tc_gl_ring *ring, unsigned program, const tc_frame_job *job, const int tile[4]);

/* Copies the results of a taken slot into the frame. */
void tc_gl_slot_copy(const tc_gl_slot *slot, const tc_frame_job *job);

#endif
