#include "renderer/halt.h"

#include <limits.h>
#include <time.h>

void tc_interrupt_init(tc_interrupt *interrupt) {
  atomic_init(&interrupt->cancel, false);
  atomic_init(&interrupt->pause_us, LLONG_MAX);
}

static int64_t now_us(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000;
}

tc_halt tc_halt_begin(const tc_interrupt *interrupt) {
  return (tc_halt){.interrupt = interrupt, .begun_us = interrupt ? now_us() : 0};
}

static bool is_cancelled(const tc_halt *halt) {
  return halt && halt->interrupt && atomic_load_explicit(&halt->interrupt->cancel, memory_order_relaxed);
}

static int64_t pause_us(const tc_halt *halt) {
  if (!halt || !halt->interrupt) return INT64_MAX;
  return atomic_load_explicit(&halt->interrupt->pause_us, memory_order_relaxed);
}

bool tc_halt_between(const tc_halt *halt) {
  int64_t pause = pause_us(halt);
  return is_cancelled(halt) || (pause != INT64_MAX && now_us() >= pause);
}

bool tc_halt_within(const tc_halt *halt) {
  int64_t pause = pause_us(halt);
  if (is_cancelled(halt)) return true;
  if (pause == INT64_MAX) return false;
  int64_t from = pause > halt->begun_us ? pause : halt->begun_us;
  return now_us() - TC_GRACE_US >= from;
}

bool tc_halt_say(const tc_halt *halt, GError **error) {
  if (is_cancelled(halt))
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "the frame was cancelled");
  else
    tc_set_error(error, TC_ERROR_PAUSED, NULL, "the frame was paused; resume it");
  return false;
}
