#include "server/session/window.h"

void tcs_window_init(tcs_window *window, unsigned limit) { *window = (tcs_window){.limit = limit ? limit : 1}; }

unsigned tcs_window_pending(const tcs_window *window) { return (unsigned)(window->sent - window->acked); }

bool tcs_window_open(const tcs_window *window, int64_t now_us) {
  const unsigned pending = tcs_window_pending(window);
  if (pending == 0) return true;
  return pending < window->limit && now_us - window->waiting_us < TCS_WINDOW_STALL_US;
}

uint64_t tcs_window_send(tcs_window *window, int64_t now_us) {
  if (tcs_window_pending(window) == 0) window->waiting_us = now_us;
  return ++window->sent;
}

bool tcs_window_ack(tcs_window *window, uint64_t frame, int64_t now_us) {
  if (frame > window->sent) return false;
  if (frame > window->acked) {
    window->acked = frame;
    window->waiting_us = now_us;
  }
  return true;
}
