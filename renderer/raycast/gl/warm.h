/* What takes long, compiling a program or uploading a volume, while frames go on elsewhere: a thread takes the context,
 * works, and lets it go. No second context shares anything; until it is done nobody else uses this one. */
#ifndef TC_RAYCAST_GL_WARM_H
#define TC_RAYCAST_GL_WARM_H

#include <pthread.h>
#include <stdatomic.h>

#include "renderer/gl/device.h"

typedef struct tc_gl_warm {
  pthread_t thread;
  bool running; /* or ended, and not taken yet */
  atomic_bool done;
  tc_gl_context *context;
  void (*work)(void *argument);
  void *argument;
} tc_gl_warm;

/* Calls work(argument) on a thread to which the context belongs from now on: it is current there, with what was bound in
 * it. False: no thread can be had, and the context is still the caller's. *warm is zeroed or was taken. */
bool tc_gl_warm_start(tc_gl_warm *warm, tc_gl_context *context, void (*work)(void *), void *argument);

bool tc_gl_warm_is_busy(const tc_gl_warm *warm);

/* Waits for the thread. True: it had work, and what that changed is the caller's again; so is the context. */
bool tc_gl_warm_take(tc_gl_warm *warm);

#endif
