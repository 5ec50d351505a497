#include "server/loop/loop.h"

#include <errno.h>
#include <sys/epoll.h>
#include <time.h>
#include <unistd.h>

#define BATCH 64

struct tcs_loop {
  int epoll_fd;
  int n_events, at; /* the batch being dispatched */
  struct epoll_event events[BATCH];
  tcs_metrics *metrics;              /* or NULL */
  double turn_began, turn_began_cpu; /* seconds; 0 = before the first turn */
};

static double seconds_of(clockid_t clock) {
  struct timespec now;
  clock_gettime(clock, &now);
  return (double)now.tv_sec + (double)now.tv_nsec / 1e9;
}

int64_t tcs_thread_cpu_us(void) { return (int64_t)(seconds_of(CLOCK_THREAD_CPUTIME_ID) * 1e6); }

tcs_loop *tcs_loop_new(GError **error) {
  tcs_loop *loop = g_new0(tcs_loop, 1);
  loop->epoll_fd = epoll_create1(EPOLL_CLOEXEC);
  if (loop->epoll_fd >= 0) return loop;
  tc_set_error(error, TC_ERROR_IO, NULL, "epoll: %s", g_strerror(errno));
  g_free(loop);
  return NULL;
}

void tcs_loop_free(tcs_loop *loop) {
  if (!loop) return;
  close(loop->epoll_fd);
  g_free(loop);
}

bool tcs_loop_add(tcs_loop *loop, tcs_source *source, uint32_t events, GError **error) {
  struct epoll_event event = {.events = events, .data.ptr = source};
  if (epoll_ctl(loop->epoll_fd, EPOLL_CTL_ADD, source->fd, &event) == 0) return true;
  tc_set_error(error, TC_ERROR_IO, NULL, "epoll: %s", g_strerror(errno));
  return false;
}

void tcs_loop_change(tcs_loop *loop, tcs_source *source, uint32_t events) {
  struct epoll_event event = {.events = events, .data.ptr = source};
  epoll_ctl(loop->epoll_fd, EPOLL_CTL_MOD, source->fd, &event);
}

void tcs_loop_remove(tcs_loop *loop, tcs_source *source) {
  epoll_ctl(loop->epoll_fd, EPOLL_CTL_DEL, source->fd, NULL);
  for (int i = loop->at; i < loop->n_events; i++)
    if (loop->events[i].data.ptr == source) loop->events[i].data.ptr = NULL;
}

void tcs_loop_set_metrics(tcs_loop *loop, tcs_metrics *metrics) { loop->metrics = metrics; }

static void end_turn(const tcs_loop *loop) {
  if (!loop->metrics || !(loop->turn_began > 0)) return;
  tcs_metrics_turn(loop->metrics, seconds_of(CLOCK_MONOTONIC) - loop->turn_began,
                   seconds_of(CLOCK_THREAD_CPUTIME_ID) - loop->turn_began_cpu);
}

static void begin_turn(tcs_loop *loop) {
  loop->turn_began = seconds_of(CLOCK_MONOTONIC);
  loop->turn_began_cpu = seconds_of(CLOCK_THREAD_CPUTIME_ID);
}

void tcs_loop_wait(tcs_loop *loop, int timeout_ms) {
  end_turn(loop);
  if (loop->at >= loop->n_events) {
    loop->at = 0;
    loop->n_events = epoll_wait(loop->epoll_fd, loop->events, BATCH, timeout_ms);
    if (loop->n_events < 0) loop->n_events = 0; /* EINTR: the caller loops anyway */
  }
  begin_turn(loop);
  while (loop->at < loop->n_events) {
    const struct epoll_event event = loop->events[loop->at++];
    tcs_source *source = event.data.ptr;
    if (source) source->ready(source, event.events);
    /* The remaining events keep their order for the next turn, so that early sources cannot starve later ones. */
    if (seconds_of(CLOCK_MONOTONIC) - loop->turn_began > TCS_TURN_US / 1e6) return;
  }
}
