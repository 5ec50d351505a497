/* Background work with the GL context. See warm.h. */
#include "renderer/raycast/gl/warm.h"

static void *run(void *argument) {
  tc_gl_warm *warm = argument;
  if (tc_gl_context_use(warm->context, NULL)) warm->work(warm->argument);
  tc_gl_context_release();
  atomic_store(&warm->done, true);
  return NULL;
}

bool tc_gl_warm_start(tc_gl_warm *warm, tc_gl_context *context, void (*work)(void *), void *argument) {
  warm->context = context;
  warm->work = work;
  warm->argument = argument;
  atomic_store(&warm->done, false);
  tc_gl_context_release();
  warm->running = pthread_create(&warm->thread, NULL, run, warm) == 0;
  if (!warm->running) tc_gl_context_use(context, NULL);
  return warm->running;
}

bool tc_gl_warm_is_busy(const tc_gl_warm *warm) { return warm->running && !atomic_load(&warm->done); }

bool tc_gl_warm_take(tc_gl_warm *warm) {
  if (!warm->running) return false;
  pthread_join(warm->thread, NULL);
  warm->running = false;
  return true;
}
