/* Background work with the GL context: a thread takes the context, compiles a program or uploads a volume, and releases
 * the context, while the cpu back end draws frames. There is only one context; until the work is done, no other thread
 * may use it. */
#ifndef TC_RAYCAST_GL_WARM_H
#define TC_RAYCAST_GL_WARM_H

#include <pthread.h>
#include <stdatomic.h>

#include "renderer/gl/device.h"

typedef struct tc_gl_warm {
  pthread_t thread;
  bool running; /* running, or ended and not taken yet */
  atomic_bool done;
  tc_gl_context *context;
  void (*work)(void *argument);
  void *argument;
} tc_gl_warm;

/* Calls work(argument) on a new thread. The thread owns the context from now on, current and with its bindings. False:
 * no thread could be created, and the context is still the caller's. *warm must be zeroed, or taken by
 * tc_gl_warm_take(). */
bool tc_gl_warm_start(tc_gl_warm *warm, tc_gl_context *context, void (*work)(void *), void *argument);

bool tc_gl_warm_is_busy(const tc_gl_warm *warm);

/* Waits for the thread. True: there was work; its results and the context belong to the caller again. False: no
 * work. */
bool tc_gl_warm_take(tc_gl_warm *warm);

#endif
