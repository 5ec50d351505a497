/* Compiling a program while frames go on: a thread takes the context, compiles and runs the program once on no pixel
 * (drivers put off part of their work until then, and it depends on the textures that are bound), and lets the context
 * go. No second context shares anything; until it is done nobody else uses this one. */
#ifndef TC_RAYCAST_GL_WARM_H
#define TC_RAYCAST_GL_WARM_H

#include <pthread.h>
#include <stdatomic.h>

#include "renderer/gl/device.h"
#include "renderer/raycast/gl/compose.h"

typedef struct tc_gl_warm {
  pthread_t thread;
  bool running; /* or ended, and not taken yet */
  atomic_bool done;
  tc_gl_context *context;
  tc_gl_variant variant;
  unsigned program; /* 0: it does not compile */
} tc_gl_warm;

/* The context is current here, with the textures and the uniform block of a frame bound; from now on it is the
 * thread's. False: no thread can be had, and the context is still the caller's. *warm is zeroed or was taken. */
bool tc_gl_warm_start(tc_gl_warm *warm, tc_gl_context *context, const tc_gl_variant *variant);

bool tc_gl_warm_is_busy(const tc_gl_warm *warm);

/* Waits for the thread. True: warm->variant and warm->program are the caller's to keep; the context may be used
 * again. */
bool tc_gl_warm_take(tc_gl_warm *warm);

#endif
