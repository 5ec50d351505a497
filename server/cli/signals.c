#include "server/cli/signals.h"

#include <errno.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "server/observe/log.h"

#define FLUSH_MOST_MS 300

struct tcs_signals {
  int heard_fd, told_fd, stop_fd; /* signalfd; eventfd that wakes the I/O thread; eventfd that ends this thread */
  int64_t most_ms;
  int64_t deadline_us; /* 0 = no end requested */
  atomic_int ends;
  atomic_bool hung_up;
  pthread_t thread;
  bool running;
};

static void post(int fd) {
  const uint64_t one = 1;
  while (write(fd, &one, sizeof one) < 0 && errno == EINTR) {
  }
}

static void hear_end(tcs_signals *signals) {
  const bool first = atomic_fetch_add(&signals->ends, 1) == 0;
  const int64_t until_us = g_get_monotonic_time() + 1000 * (first ? signals->most_ms : TCS_SIGNALS_SECOND_MS);
  if (first || until_us < signals->deadline_us) signals->deadline_us = until_us;
  post(signals->told_fd);
}

static void hear_hangup(tcs_signals *signals) {
  tcs_log_reopen();
  atomic_store(&signals->hung_up, true);
  post(signals->told_fd);
}

static void hear(tcs_signals *signals) {
  struct signalfd_siginfo info;
  while (read(signals->heard_fd, &info, sizeof info) == sizeof info) {
    if (info.ssi_signo == SIGHUP)
      hear_hangup(signals);
    else
      hear_end(signals);
  }
}

/* Ends the process although an import, a disk or a driver hangs; nothing of value is lost. Uses the system call, since
 * sanitizers make _exit() report leaks, and here nothing was freed. */
static void leave(void) {
  tcs_log(TCS_LOG_WARN, "stop.forced", "text=\"some work did not end in time and was abandoned\"");
  tcs_log_flush(FLUSH_MOST_MS);
  syscall(SYS_exit_group, 0);
}

static void *signals_main(void *user) {
  tcs_signals *signals = user;
  struct pollfd fds[2] = {{signals->heard_fd, POLLIN, 0}, {signals->stop_fd, POLLIN, 0}};
  pthread_setname_np(pthread_self(), "tc-signals");
  while (!fds[1].revents) {
    const int64_t left_us = signals->deadline_us - g_get_monotonic_time();
    if (signals->deadline_us && left_us <= 0) leave();
    if (poll(fds, 2, signals->deadline_us ? (int)(left_us / 1000 + 1) : -1) > 0 && fds[0].revents) hear(signals);
  }
  return NULL;
}

static bool fail(GError **error, const char *what, int why) {
  tc_set_error(error, TC_ERROR_IO, NULL, "%s: %s", what, g_strerror(why));
  return false;
}

static bool begin(tcs_signals *signals, GError **error) {
  sigset_t set;
  sigemptyset(&set);
  sigaddset(&set, SIGTERM);
  sigaddset(&set, SIGINT);
  sigaddset(&set, SIGHUP);
  signal(SIGPIPE, SIG_IGN);
  pthread_sigmask(SIG_BLOCK, &set, NULL);
  if ((signals->heard_fd = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK)) < 0) return fail(error, "signalfd", errno);
  if ((signals->told_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) < 0 ||
      (signals->stop_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) < 0)
    return fail(error, "eventfd", errno);
  const int failure = pthread_create(&signals->thread, NULL, signals_main, signals);
  signals->running = failure == 0;
  return signals->running || fail(error, "start thread tc-signals", failure);
}

tcs_signals *tcs_signals_new(int64_t most_ms, GError **error) {
  tcs_signals *signals = g_new0(tcs_signals, 1);
  *signals = (tcs_signals){.heard_fd = -1, .told_fd = -1, .stop_fd = -1, .most_ms = most_ms};
  if (begin(signals, error)) return signals;
  tcs_signals_free(signals);
  return NULL;
}

void tcs_signals_free(tcs_signals *signals) {
  if (!signals) return;
  if (signals->running) {
    post(signals->stop_fd);
    pthread_join(signals->thread, NULL);
  }
  if (signals->heard_fd >= 0) close(signals->heard_fd);
  if (signals->told_fd >= 0) close(signals->told_fd);
  if (signals->stop_fd >= 0) close(signals->stop_fd);
  g_free(signals);
}

int tcs_signals_fd(const tcs_signals *signals) { return signals->told_fd; }

int tcs_signals_ends(tcs_signals *signals) {
  uint64_t count;
  while (read(signals->told_fd, &count, sizeof count) < 0 && errno == EINTR) {
  }
  return atomic_load(&signals->ends);
}

bool tcs_signals_hung_up(tcs_signals *signals) { return atomic_exchange(&signals->hung_up, false); }
