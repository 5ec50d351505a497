#include "server/loop/loop.h"

#include <errno.h>
#include <sys/epoll.h>
#include <unistd.h>

#define BATCH 64

struct tcs_loop {
  int epoll_fd;
  int n_events, at; /* the batch being worked on */
  struct epoll_event events[BATCH];
};

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

void tcs_loop_wait(tcs_loop *loop, int timeout_ms) {
  loop->n_events = epoll_wait(loop->epoll_fd, loop->events, BATCH, timeout_ms);
  if (loop->n_events < 0) loop->n_events = 0; /* EINTR: the caller comes round again */
  for (loop->at = 0; loop->at < loop->n_events;) {
    const struct epoll_event event = loop->events[loop->at++];
    tcs_source *source = event.data.ptr;
    if (source) source->ready(source, event.events);
  }
  loop->n_events = loop->at = 0;
}
