/* Sends voxels and requests to the daemon and reads its replies. */
#include "renderer/import/helper/output.h"

#include <errno.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>

static bool gone(GError **error) {
  tc_set_error(error, TC_ERROR_CANCELLED, NULL, "nobody listens any more");
  return false;
}

/* Reads the next reply: counts a free slot, or returns *what with a descriptor or -1. */
static bool hear(tc_output *o, char *what, int *fd, GError **error) {
  union {
    struct cmsghdr align;
    char bytes[CMSG_SPACE(sizeof(int))];
  } control = {0};
  struct iovec part = {what, 1};
  struct msghdr message = {
      .msg_iov = &part, .msg_iovlen = 1, .msg_control = &control, .msg_controllen = sizeof control};
  ssize_t n;
  do n = recvmsg(TC_HELPER_SOCKET_FD, &message, MSG_CMSG_CLOEXEC);
  while (n < 0 && errno == EINTR);
  if (n != 1) return gone(error);
  const struct cmsghdr *header = CMSG_FIRSTHDR(&message);
  *fd = -1;
  if (header && header->cmsg_type == SCM_RIGHTS) memcpy(fd, CMSG_DATA(header), sizeof *fd);
  if (*what == TC_WIRE_FREE && o->busy > 0) o->busy--;
  return true;
}

static bool want(void *user, uint64_t bytes, GError **error) {
  return tc_wire_send_want(TC_HELPER_SOCKET_FD, bytes) || gone(error);
}

static bool begin(void *user, const tc_volume_desc *desc, const tc_provenance *from, GError **error) {
  return tc_wire_send_head(TC_HELPER_SOCKET_FD, desc, from) || gone(error);
}

static bool begin_mesh(void *user, const tc_mesh_head *head, GError **error) {
  return tc_wire_send_mesh(TC_HELPER_SOCKET_FD, head) || gone(error);
}

static bool begin_model(void *user, uint64_t bytes, GError **error) {
  return tc_wire_send_model(TC_HELPER_SOCKET_FD, bytes) || gone(error);
}

static bool segment(void *user, const tc_segment *s, GError **error) {
  return tc_wire_send_segment(TC_HELPER_SOCKET_FD, s) || gone(error);
}

static void *room(void *user, GError **error) {
  tc_output *o = user;
  char what;
  int fd;
  while (o->busy == TC_WIRE_SLOTS)
    if (!hear(o, &what, &fd, error)) return NULL;
  return o->ring + (size_t)o->next * TC_WIRE_SLOT_BYTES;
}

static bool filled(void *user, size_t bytes, GError **error) {
  tc_output *o = user;
  const unsigned slot = o->next;
  o->next = (slot + 1) % TC_WIRE_SLOTS;
  o->busy++;
  return tc_wire_send_voxels(TC_HELPER_SOCKET_FD, slot, bytes) || gone(error);
}

/* The daemon decides whether to continue. This reports visible progress and shows that the helper is alive. */
static bool goes_on(void *user, double fraction, GError **error) {
  tc_output *o = user;
  const int64_t now_us = g_get_monotonic_time();
  if (fraction >= o->told && fraction < o->told + 0.01 && fraction < 1 && now_us - o->told_us < 20000) return true;
  o->told = fraction;
  o->told_us = now_us;
  return tc_wire_send_progress(TC_HELPER_SOCKET_FD, fraction < 1 ? fraction : 1) || gone(error);
}

static int ask_for_file(void *user, const char *name, bool optional, GError **error) {
  char what = 0;
  int fd = -1;
  if (!tc_wire_send_open(TC_HELPER_SOCKET_FD, name, optional)) return gone(error), -1;
  while (what != TC_WIRE_FILE && what != TC_WIRE_MISSING)
    if (!hear(user, &what, &fd, error)) return -1;
  return fd;
}

bool tc_output_init(tc_output *o, tc_order *order, GError **error) {
  *o = (tc_output){0};
  *order = (tc_order){.user = o,
                      .want = want,
                      .begin = begin,
                      .begin_mesh = begin_mesh,
                      .begin_model = begin_model,
                      .segment = segment,
                      .room = room,
                      .filled = filled,
                      .goes_on = goes_on,
                      .open = ask_for_file};
  o->ring = mmap(NULL, TC_WIRE_RING_BYTES, PROT_READ | PROT_WRITE, MAP_SHARED, TC_HELPER_RING_FD, 0);
  if (o->ring != MAP_FAILED) return true;
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "no memory to share with the decoder");
  return false;
}

bool tc_order_put(const tc_order *order, const void *voxels, size_t bytes, GError **error) {
  for (const char *at = voxels; bytes > 0;) {
    const size_t n = bytes < TC_ORDER_MOST_BYTES ? bytes : TC_ORDER_MOST_BYTES;
    void *to = order->room(order->user, error);
    if (!to) return false;
    memcpy(to, at, n);
    if (!order->filled(order->user, n, error)) return false;
    at += n;
    bytes -= n;
  }
  return true;
}

bool tc_order_elsewhere(tc_helper helper, GError **error) {
  g_set_error_literal(error, TC_ERROR, TC_WIRE_ELSEWHERE + (int)helper, "another decoder reads this");
  return false;
}

bool tc_choice_volume(const char *choice, const char *format, uint32_t *volume, GError **error) {
  guint64 number = 0;
  if (!*choice) return true;
  if (g_str_has_prefix(choice, "volume=") && g_ascii_string_to_unsigned(choice + 7, 10, 1, 1 << 24, &number, NULL)) {
    *volume = (uint32_t)number;
    return true;
  }
  tc_set_error(error, TC_ERROR_INVALID, NULL, "%s holds no series: after '#' give nothing, or volume=N", format);
  return false;
}
