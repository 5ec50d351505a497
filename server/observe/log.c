#include "server/observe/log.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "renderer/error.h"

#define LINE 1024
#define PIECE 16384 /* bytes the thread takes out of the ring at a time */

static const char *const level_names[TCS_LOG_LEVEL_COUNT] = {"debug", "info", "warn", "error"};
static tcs_log_level threshold = TCS_LOG_INFO;

/* All of it under `mutex`, but for fd and path: they are the writer's, and set before it starts. */
static struct {
  pthread_mutex_t mutex;
  pthread_cond_t filled, written;
  char ring[TCS_LOG_RING];
  size_t first, used;           /* of the ring: lines end to end */
  uint64_t put, out;            /* bytes ever put into the ring; of them, ever written or given up */
  uint64_t dropped, told;       /* lines dropped; of them, those the log has told of */
  bool running, ending, reopen; /* running: there is a thread that empties the ring */
  pthread_t thread;
  int fd;
  char *path; /* NULL: stderr */
} state = {.mutex = PTHREAD_MUTEX_INITIALIZER, .filled = PTHREAD_COND_INITIALIZER, .fd = STDERR_FILENO};

void tcs_log_set_level(tcs_log_level level) { threshold = level; }

gboolean tcs_log_level_parse(const char *name, tcs_log_level *level) {
  for (int i = 0; i < TCS_LOG_LEVEL_COUNT; i++) {
    if (strcmp(name, level_names[i]) == 0) {
      *level = (tcs_log_level)i;
      return TRUE;
    }
  }
  return FALSE;
}

uint64_t tcs_log_dropped(void) {
  pthread_mutex_lock(&state.mutex);
  const uint64_t dropped = state.dropped;
  pthread_mutex_unlock(&state.mutex);
  return dropped;
}

/* --- one line --------------------------------------------------------------------------------------- */

static size_t format_line(char line[LINE], tcs_log_level level, const char *event, const char *format, va_list values) {
  struct timespec now;
  struct tm utc;
  clock_gettime(CLOCK_REALTIME, &now);
  gmtime_r(&now.tv_sec, &utc);
  size_t used = strftime(line, LINE, "%Y-%m-%dT%H:%M:%S", &utc);
  used += (size_t)snprintf(line + used, LINE - used, ".%03ldZ %s %s%s", now.tv_nsec / 1000000, level_names[level],
                           event, format ? " " : "");
  if (format) {
    vsnprintf(line + used, LINE - used - 1, format, values);
    for (char *c = line + used; *c; c++)
      if ((unsigned char)*c < 0x20 || *c == 0x7f) *c = ' ';
  }
  const size_t length = strlen(line);
  line[length] = '\n';
  return length + 1;
}

static size_t format_own(char line[LINE], tcs_log_level level, const char *event, const char *format, ...)
    G_GNUC_PRINTF(4, 5);
static size_t format_own(char line[LINE], tcs_log_level level, const char *event, const char *format, ...) {
  va_list values;
  va_start(values, format);
  const size_t size = format_line(line, level, event, format, values);
  va_end(values);
  return size;
}

/* May wait for ever: stderr is shared with other processes, so it cannot be told not to. */
static bool write_all(const char *bytes, size_t size) {
  while (size > 0) {
    const ssize_t wrote = write(state.fd, bytes, size);
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote < 0 && errno == EAGAIN) { /* another process told the pipe not to wait */
      struct pollfd room = {.fd = state.fd, .events = POLLOUT};
      if (poll(&room, 1, -1) > 0 && !(room.revents & POLLERR)) continue;
    }
    if (wrote < 0) return false;
    bytes += wrote;
    size -= (size_t)wrote;
  }
  return true;
}

static void put(const char *line, size_t size) {
  if (TCS_LOG_RING - state.used < size) {
    state.dropped++;
    return;
  }
  for (size_t at = (state.first + state.used) % TCS_LOG_RING, left = size; left > 0; at = 0) {
    const size_t count = MIN(left, TCS_LOG_RING - at);
    memcpy(state.ring + at, line + size - left, count);
    left -= count;
  }
  state.used += size;
  state.put += size;
  pthread_cond_signal(&state.filled);
}

void tcs_log(tcs_log_level level, const char *event, const char *format, ...) {
  if (level < threshold) return;
  char line[LINE];
  va_list values;
  va_start(values, format);
  const size_t size = format_line(line, level, event, format, values);
  va_end(values);
  pthread_mutex_lock(&state.mutex);
  const bool running = state.running;
  if (running) put(line, size);
  pthread_mutex_unlock(&state.mutex);
  if (!running) (void)write_all(line, size); /* nowhere left to say that it failed */
}

/* --- the thread ------------------------------------------------------------------------------------- */

static uint64_t lines_in(const char *bytes, size_t size) {
  uint64_t lines = 0;
  for (size_t i = 0; i < size; i++)
    lines += bytes[i] == '\n';
  return lines;
}

/* Whole lines, or one line's piece where the ring wraps. */
static size_t take(char *piece) {
  size_t size = MIN(MIN(state.used, (size_t)PIECE), TCS_LOG_RING - state.first);
  memcpy(piece, state.ring + state.first, size);
  state.first = (state.first + size) % TCS_LOG_RING;
  state.used -= size;
  return size;
}

static int open_file(const char *path) { return open(path, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0640); }

static void reopen(void) {
  if (!state.path) return;
  const int fd = open_file(state.path);
  if (fd >= 0) {
    close(state.fd);
    state.fd = fd;
    return;
  }
  char line[LINE];
  const size_t size = format_own(line, TCS_LOG_ERROR, "log.reopen", "text=\"%s; the old file is written on\"",
                                 g_strerror(errno));
  (void)write_all(line, size);
}

/* Called and left with the mutex held. */
static void write_some(void) {
  char piece[PIECE], line[LINE];
  const size_t size = take(piece);
  const uint64_t missing = state.dropped - state.told;
  const bool anew = state.reopen;
  state.reopen = false;
  pthread_mutex_unlock(&state.mutex);
  if (anew) reopen();
  bool good = write_all(piece, size);
  /* What was dropped came after what was in the ring by then, or nearly; a line may be cut at the end of a piece. */
  const bool tell = good && missing && size > 0 && piece[size - 1] == '\n';
  if (tell) good = write_all(line, format_own(line, TCS_LOG_WARN, "log.lost", "text=\"%" G_GUINT64_FORMAT " lines lost\"",
                                              missing));
  pthread_mutex_lock(&state.mutex);
  state.out += size;
  if (tell && good) state.told += missing;
  if (!good) state.dropped += lines_in(piece, size);
  pthread_cond_broadcast(&state.written);
}

static void *log_main(void *user) {
  pthread_setname_np(pthread_self(), "tc-log");
  pthread_mutex_lock(&state.mutex);
  while (!state.ending || state.used > 0) {
    if (state.used > 0 || state.reopen)
      write_some();
    else
      pthread_cond_wait(&state.filled, &state.mutex);
  }
  pthread_mutex_unlock(&state.mutex);
  return NULL;
}

bool tcs_log_open(const char *path, GError **error) {
  const int fd = path ? open_file(path) : STDERR_FILENO;
  if (fd < 0) {
    tc_set_error(error, TC_ERROR_IO, NULL, "--log %s: %s", path, g_strerror(errno));
    return false;
  }
  if (state.path) close(state.fd);
  g_free(state.path);
  state.path = g_strdup(path);
  state.fd = fd;
  return true;
}

void tcs_log_reopen(void) {
  pthread_mutex_lock(&state.mutex);
  state.reopen = true;
  pthread_cond_signal(&state.filled);
  pthread_mutex_unlock(&state.mutex);
}

void tcs_log_start(void) {
  pthread_condattr_t clock;
  pthread_condattr_init(&clock);
  pthread_condattr_setclock(&clock, CLOCK_MONOTONIC);
  pthread_cond_init(&state.written, &clock);
  pthread_condattr_destroy(&clock);
  state.ending = false;
  state.running = pthread_create(&state.thread, NULL, log_main, NULL) == 0;
}

/* With the mutex held. */
static bool wait_written(int most_ms) {
  struct timespec until;
  const uint64_t all = state.put;
  clock_gettime(CLOCK_MONOTONIC, &until);
  until.tv_sec += most_ms / 1000;
  until.tv_nsec += most_ms % 1000 * 1000000L;
  if (until.tv_nsec >= 1000000000L) until.tv_sec++, until.tv_nsec -= 1000000000L;
  while (state.running && state.out < all)
    if (pthread_cond_timedwait(&state.written, &state.mutex, &until) == ETIMEDOUT) break;
  return state.out >= all;
}

bool tcs_log_flush(int most_ms) {
  pthread_mutex_lock(&state.mutex);
  const bool written = wait_written(most_ms);
  pthread_mutex_unlock(&state.mutex);
  return written;
}

void tcs_log_stop(int most_ms) {
  pthread_mutex_lock(&state.mutex);
  const bool running = state.running, written = wait_written(most_ms);
  state.running = running && !written; /* what comes now is written at once, or not at all where the pipe is full */
  state.ending = true;
  pthread_cond_signal(&state.filled);
  pthread_mutex_unlock(&state.mutex);
  if (!running) return;
  if (written)
    pthread_join(state.thread, NULL);
  else
    pthread_detach(state.thread);
}
