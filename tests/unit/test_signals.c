/* The end that comes even where the daemon's own does not: in child processes, which hang. */
#include "tests/support/test.h"

#include <poll.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include "server/cli/signals.h"

/* A process that hears signals and does nothing about them. */
static pid_t hang(int64_t most_ms) {
  int ready[2];
  char byte = 0;
  assert_int_equal(pipe(ready), 0);
  const pid_t child = fork();
  if (child == 0) {
    if (!tcs_signals_new(most_ms, NULL)) _exit(1);
    if (write(ready[1], &byte, 1) != 1) _exit(1);
    for (;;) pause();
  }
  assert_int_equal(read(ready[0], &byte, 1), 1);
  close(ready[0]);
  close(ready[1]);
  return child;
}

static double seconds_until_end(pid_t child) {
  const int64_t began = g_get_monotonic_time();
  int status;
  assert_int_equal(waitpid(child, &status, 0), child);
  assert_true(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  return (double)(g_get_monotonic_time() - began) / 1e6;
}

TEST(test_what_hangs_is_left) {
  const pid_t child = hang(300);
  kill(child, SIGTERM);
  const double seconds = seconds_until_end(child);
  assert_true(seconds >= 0.2 && seconds < 5);
}

TEST(test_a_second_signal_does_not_wait) {
  const pid_t child = hang(60000);
  kill(child, SIGTERM);
  g_usleep(50000);
  kill(child, SIGINT);
  assert_true(seconds_until_end(child) < 10);
}

TEST(test_a_hangup_ends_nothing) {
  const pid_t child = hang(200);
  kill(child, SIGHUP);
  g_usleep(500000);
  assert_int_equal(waitpid(child, NULL, WNOHANG), 0);
  kill(child, SIGTERM);
  seconds_until_end(child);
}

TEST(test_wishes_are_counted) {
  tcs_signals *signals = tcs_signals_new(60000, NULL);
  struct pollfd heard = {.fd = tcs_signals_fd(signals), .events = POLLIN};
  assert_int_equal(tcs_signals_ends(signals), 0);
  kill(getpid(), SIGTERM);
  assert_int_equal(poll(&heard, 1, 10000), 1);
  assert_int_equal(tcs_signals_ends(signals), 1);
  assert_int_equal(poll(&heard, 1, 0), 0); /* quiet again */
  tcs_signals_free(signals);
}

TESTS(NULL, NULL)
