/* Checks that a helper process is sandboxed when it reads. */
#ifndef TC_TESTS_CONFINED_H
#define TC_TESTS_CONFINED_H

#include <fcntl.h>
#include <glib.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "renderer/import/wire.h"

/* A numeric field of /proc/PID/status; -1 if absent. */
static inline int status_field(pid_t pid, const char *field) {
  char path[64], *text = NULL;
  int value = -1;
  snprintf(path, sizeof path, "/proc/%d/status", (int)pid);
  const char *at = g_file_get_contents(path, &text, NULL, NULL) ? strstr(text, field) : NULL;
  if (at) value = atoi(at + strlen(field));
  g_free(text);
  return value;
}

/* Starts a helper directly and does not read the voxels, so that it blocks in the middle of its reply, sandboxed. */
static inline void is_confined(const char *name, const char *path) {
  int ends[2], input = open(path, O_RDONLY), ring = memfd_create("ring", 0);
  char *helper = g_build_filename(TC_BINARY_DIR, name, NULL);
  tc_helper_request request = {.address_bytes = 8ull << 30, .cpu_seconds = 60, .name = "f"};
  request.without_landlock = g_getenv("TOMOCAST_WITHOUT_LANDLOCK") != NULL;
  assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, ends), 0);
  assert_true(input >= 0 && ring >= 0 && ftruncate(ring, TC_WIRE_RING_BYTES) == 0);
  pid_t pid = fork();
  if (pid == 0) {
    if (dup2(input, 20) < 0 || dup2(ends[1], 21) < 0 || dup2(ring, 22) < 0) _exit(99);
    if (dup2(20, 3) < 0 || dup2(21, 4) < 0 || dup2(22, 5) < 0) _exit(99);
    execl(helper, helper, (char *)NULL);
    _exit(99);
  }
  assert_true(pid > 0 && write(ends[0], &request, sizeof request) == sizeof request);
  for (int wait = 0; wait < 500 && status_field(pid, "\nSeccomp:") != 2; wait++) g_usleep(20000);
  int seccomp = status_field(pid, "\nSeccomp:"), privileges = status_field(pid, "\nNoNewPrivs:"),
      capabilities = status_field(pid, "\nCapPrm:"), tasks = status_field(pid, "\nThreads:");
  char *oom = g_strdup_printf("/proc/%d/oom_score_adj", (int)pid), *score = NULL;
  assert_true(g_file_get_contents(oom, &score, NULL, NULL));
  kill(pid, SIGKILL);
  waitpid(pid, NULL, 0);
  close(ends[0]);
  close(ends[1]);
  close(input);
  close(ring);
  assert_int_equal(seccomp, 2); /* filter mode */
  assert_int_equal(privileges, 1);
  assert_int_equal(tasks, 1);
  assert_int_equal(capabilities, 0);    /* even if the test runs as root */
  assert_string_equal(score, "1000\n"); /* first victim of the OOM killer */
  g_free(oom);
  g_free(score);
  g_free(helper);
}

#endif
