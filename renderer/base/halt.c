#include "renderer/base/halt.h"

#include <limits.h>
#include <time.h>

#define MOST_DOUBLINGS 16

void tc_interrupt_init(tc_interrupt *interrupt) {
  atomic_init(&interrupt->cancel, false);
  atomic_init(&interrupt->pause_us, LLONG_MAX);
}

static int64_t now_us(void) {
  struct timespec t;
  clock_gettime(CLOCK_MONOTONIC, &t);
  return (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000;
}

#ifdef TC_TEST_BUILD
tc_halt_probe tc_halt_probed;
static atomic_int probe_number;

void tc_halt_probe_begin(long long cancels_at) {
  atomic_fetch_add(&probe_number, 1);
  tc_halt_probed.on = true;
  tc_halt_probed.cancels_at = cancels_at;
  atomic_store(&tc_halt_probed.looks, 0);
  atomic_store(&tc_halt_probed.longest_us, 0);
}

/* True: cancel. */
static bool probe_look(void) {
  static _Thread_local int number;
  static _Thread_local int64_t last_us;
  if (!tc_halt_probed.on) return false;
  struct timespec t;
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  int64_t now = (int64_t)t.tv_sec * 1000000 + t.tv_nsec / 1000, gap = now - last_us;
  long long longest = atomic_load(&tc_halt_probed.longest_us);
  if (number == atomic_load(&probe_number))
    while (gap > longest && !atomic_compare_exchange_weak(&tc_halt_probed.longest_us, &longest, gap)) continue;
  number = atomic_load(&probe_number);
  last_us = now;
  return atomic_fetch_add(&tc_halt_probed.looks, 1) + 1 >= tc_halt_probed.cancels_at;
}
#else
static bool probe_look(void) { return false; }
#endif

tc_halt tc_halt_begin(const tc_interrupt *interrupt, int fruitless) {
  if (interrupt) probe_look();
  return (tc_halt){.interrupt = interrupt, .begun_us = interrupt ? now_us() : 0,
                   .grace_us = (int64_t)TC_GRACE_US << (fruitless < MOST_DOUBLINGS ? fruitless : MOST_DOUBLINGS)};
}

static bool is_cancelled(const tc_halt *halt) {
  if (!halt || !halt->interrupt) return false;
  return probe_look() || atomic_load_explicit(&halt->interrupt->cancel, memory_order_relaxed);
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
  return now_us() - halt->grace_us >= from;
}

bool tc_halt_say(const tc_halt *halt, GError **error) {
  if (is_cancelled(halt))
    tc_set_error(error, TC_ERROR_CANCELLED, NULL, "the frame was cancelled");
  else
    tc_set_error(error, TC_ERROR_PAUSED, NULL, "the frame was paused; resume it");
  return false;
}
