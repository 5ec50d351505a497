#include "server/http/guard.h"

#include <errno.h>
#include <sys/socket.h>

#define PIECE 4096 /* bytes per read while the end of the request is unknown */

struct tcs_guard {
  GHashTable *by_fd; /* tcs_strict * */
};

static _Thread_local const tcs_guard *running;

tcs_guard *tcs_guard_new(void) {
  tcs_guard *guard = g_new0(tcs_guard, 1);
  guard->by_fd = g_hash_table_new_full(NULL, NULL, NULL, (GDestroyNotify)tcs_strict_free);
  return guard;
}

void tcs_guard_free(tcs_guard *guard) {
  if (!guard) return;
  g_hash_table_destroy(guard->by_fd);
  g_free(guard);
}

tcs_strict *tcs_guard_add(tcs_guard *guard, int fd) {
  tcs_strict *strict = tcs_strict_new();
  g_hash_table_insert(guard->by_fd, GINT_TO_POINTER(fd), strict);
  return strict;
}

void tcs_guard_remove(tcs_guard *guard, int fd) { g_hash_table_remove(guard->by_fd, GINT_TO_POINTER(fd)); }

void tcs_guard_run(tcs_guard *guard, struct MHD_Daemon *daemon) {
  running = guard;
  MHD_run(daemon);
  running = NULL;
}

static ssize_t plain_recv(int fd, void *bytes, size_t size, int flags) {
  return recvfrom(fd, bytes, size, flags, NULL, NULL);
}

/* Reads once from the socket; bytes that certainly belong to the body go directly to the library's buffer. *empty: the
 * socket has no more. */
static ssize_t feed(tcs_strict *strict, int fd, uint8_t *bytes, size_t room, size_t *filled, bool *empty) {
  const size_t direct = tcs_strict_direct(strict, room);
  if (direct) {
    const ssize_t got = plain_recv(fd, bytes, direct, 0);
    if (got > 0) tcs_strict_passed(strict, (size_t)got), *filled += (size_t)got;
    *empty = got < (ssize_t)direct;
    return got;
  }
  uint8_t piece[PIECE];
  const ssize_t got = plain_recv(fd, piece, sizeof piece, 0);
  if (got > 0) tcs_strict_give(strict, piece, (size_t)got);
  *empty = got < (ssize_t)sizeof piece;
  return got;
}

/* Returns less than `size` only when the socket is empty: the library takes that as the sign to wait. It then does not
 * read the socket again, since the next read may be the end of the connection, which the library must see itself. */
static ssize_t guarded_recv(tcs_strict *strict, int fd, uint8_t *bytes, size_t size) {
  size_t filled = 0;
  bool empty = false;
  for (;;) {
    filled += tcs_strict_take(strict, bytes + filled, size - filled);
    if (filled == size || (filled && empty)) return (ssize_t)filled;
    if (!tcs_strict_hungry(strict)) {
      errno = EAGAIN;
      return filled ? (ssize_t)filled : -1;
    }
    const ssize_t got = feed(strict, fd, bytes + filled, size - filled, &filled, &empty);
    if (got <= 0) return filled ? (ssize_t)filled : got;
  }
}

ssize_t recv(int fd, void *bytes, size_t size, int flags) {
  tcs_strict *strict = running && !flags && size ? g_hash_table_lookup(running->by_fd, GINT_TO_POINTER(fd)) : NULL;
  return strict ? guarded_recv(strict, fd, bytes, size) : plain_recv(fd, bytes, size, flags);
}
