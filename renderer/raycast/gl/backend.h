/* Access to the gl back end beyond renderer/frame/backend.h, for measurements and tests. Same thread rule as tc_render(). */
#ifndef TC_RAYCAST_GL_BACKEND_H
#define TC_RAYCAST_GL_BACKEND_H

#include "renderer/gl/device.h"
#include "renderer/raycast/gl/compose.h"

/* `instance` is what tc_gl_backend.create() returned. */
const tc_gl_report *tc_gl_backend_report(const void *instance);

/* GPU time of the last frame's dispatches, read-back not counted; 0 where the driver has no clock. */
double tc_gl_backend_gpu_ms(const void *instance);

/* Programs compiled since creation. */
uint64_t tc_gl_backend_compiled(const void *instance);

#endif
