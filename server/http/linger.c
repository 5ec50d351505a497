#include "server/http/linger.h"

#include <errno.h>
#include <fcntl.h>
#include <sys/epoll.h>
#include <sys/socket.h>
#include <unistd.h>

#define MOST_US 10000000
#define MOST_BYTES (INT64_C(64) << 20)
#define MOST_LEAVERS 64
#define TURN_PIECES 16 /* reads per connection and turn of the loop */

typedef struct leaver {
  tcs_source source; /* must be first: the loop passes the source */
  tcs_linger *linger;
  GList link;
  int64_t until_us, left_bytes;
} leaver;

struct tcs_linger {
  tcs_loop *loop;
  GQueue leavers; /* oldest first */
};

static void let_go(leaver *l) {
  tcs_loop_remove(l->linger->loop, &l->source);
  g_queue_unlink(&l->linger->leavers, &l->link);
  close(l->source.fd);
  g_free(l);
}

/* Discards input. False: the peer has closed, or has sent too much. */
static bool throw_away(leaver *l) {
  static uint8_t nowhere[65536];
  for (int i = 0; i < TURN_PIECES && l->left_bytes > 0; i++) {
    const ssize_t got =
        recv(l->source.fd, nowhere, sizeof nowhere, MSG_DONTWAIT | MSG_TRUNC); /* TCP discards without copying */
    if (got < 0 && (errno == EAGAIN || errno == EINTR)) return true;
    if (got <= 0) return false;
    l->left_bytes -= got;
  }
  return l->left_bytes > 0;
}

static void on_bytes(tcs_source *source, uint32_t events) {
  leaver *l = (leaver *)source;
  if (!throw_away(l)) let_go(l);
}

tcs_linger *tcs_linger_new(tcs_loop *loop) {
  tcs_linger *linger = g_new0(tcs_linger, 1);
  linger->loop = loop;
  g_queue_init(&linger->leavers);
  return linger;
}

void tcs_linger_free(tcs_linger *linger) {
  if (!linger) return;
  while (linger->leavers.head) let_go(linger->leavers.head->data);
  g_free(linger);
}

void tcs_linger_add(tcs_linger *linger, int fd) {
  leaver *l = g_new0(leaver, 1);
  *l = (leaver){.source = {on_bytes, fcntl(fd, F_DUPFD_CLOEXEC, 0)}, .linger = linger, .left_bytes = MOST_BYTES};
  l->until_us = g_get_monotonic_time() + MOST_US;
  l->link.data = l;
  if (l->source.fd < 0 || !throw_away(l) || !tcs_loop_add(linger->loop, &l->source, EPOLLIN, NULL)) {
    if (l->source.fd >= 0) close(l->source.fd);
    g_free(l);
    return;
  }
  shutdown(l->source.fd, SHUT_WR);
  if (linger->leavers.length >= MOST_LEAVERS) let_go(linger->leavers.head->data);
  g_queue_push_tail_link(&linger->leavers, &l->link);
}

void tcs_linger_tick(tcs_linger *linger, int64_t now_us) {
  for (leaver *l; linger->leavers.head && now_us >= (l = linger->leavers.head->data)->until_us;) let_go(l);
}
