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

#include "renderer/base/error.h"

#define LINE 1024
#define PIECE 16384 /* most bytes the thread takes out of the ring at a time */

static const char *const level_names[TCS_LOG_LEVEL_COUNT] = {"debug", "info", "warn", "error"};
static tcs_log_level threshold = TCS_LOG_INFO;

/* One output with its ring. `mutex` protects everything but fd and path, which are set before the writer thread starts
 * and belong to it from then on. */
typedef struct sink {
  const char *option, *thread_name;
  mode_t mode; /* file permissions */
  pthread_mutex_t mutex;
  pthread_cond_t filled, written;
  char ring[TCS_LOG_RING];
  size_t first, used;           /* of the ring: offset of the first byte, bytes in use */
  uint64_t put, out;            /* bytes ever put into the ring; bytes ever taken out and written or lost */
  uint64_t dropped, told;       /* lines dropped; dropped lines reported so far */
  bool running, ending, reopen; /* running: a thread empties the ring */
  pthread_t thread;
  int fd;
  char *path; /* NULL: stderr */
} sink;

#define SINK(option, name, file_mode, first_fd)                                                                        \
  { option, name, file_mode, .mutex = PTHREAD_MUTEX_INITIALIZER, .filled = PTHREAD_COND_INITIALIZER, .fd = first_fd }

static sink everything = SINK("--log", "tc-log", 0640, STDERR_FILENO);
static sink audit = SINK("--audit-file", "tc-audit", 0600, -1);
static bool audited; /* the audit sink is open */

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
  uint64_t dropped = 0;
  for (int i = 0; i < 2; i++) {
    sink *to = i ? &audit : &everything;
    pthread_mutex_lock(&to->mutex);
    dropped += to->dropped;
    pthread_mutex_unlock(&to->mutex);
  }
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

/* May block for ever: stderr is shared with other processes, so O_NONBLOCK is not ours to set. */
static bool write_all(const sink *to, const char *bytes, size_t size) {
  while (size > 0) {
    const ssize_t wrote = write(to->fd, bytes, size);
    if (wrote < 0 && errno == EINTR) continue;
    if (wrote < 0 && errno == EAGAIN) { /* another process set O_NONBLOCK */
      struct pollfd room = {.fd = to->fd, .events = POLLOUT};
      if (poll(&room, 1, -1) > 0 && !(room.revents & POLLERR)) continue;
    }
    if (wrote < 0) return false;
    bytes += wrote;
    size -= (size_t)wrote;
  }
  return true;
}

static void put(sink *to, const char *line, size_t size) {
  if (TCS_LOG_RING - to->used < size) {
    to->dropped++;
    return;
  }
  for (size_t at = (to->first + to->used) % TCS_LOG_RING, left = size; left > 0; at = 0) {
    const size_t count = MIN(left, TCS_LOG_RING - at);
    memcpy(to->ring + at, line + size - left, count);
    left -= count;
  }
  to->used += size;
  to->put += size;
}

static void emit(sink *to, const char *line, size_t size) {
  pthread_mutex_lock(&to->mutex);
  const bool running = to->running;
  if (running) put(to, line, size);
  pthread_mutex_unlock(&to->mutex);
  /* Signals after unlocking: the writer may preempt this thread at once, and a preempted thread of low priority would
   * hold the lock for long. */
  if (running) pthread_cond_signal(&to->filled);
  if (!running) (void)write_all(to, line, size); /* no way left to report a failure */
}

void tcs_log(tcs_log_level level, const char *event, const char *format, ...) {
  const bool also = audited && g_str_has_prefix(event, "audit.");
  if (level < threshold && !also) return;
  char line[LINE];
  va_list values;
  va_start(values, format);
  const size_t size = format_line(line, level, event, format, values);
  va_end(values);
  if (level >= threshold) emit(&everything, line, size);
  if (also) emit(&audit, line, size);
}

/* --- the thread ------------------------------------------------------------------------------------- */

static uint64_t lines_in(const char *bytes, size_t size) {
  uint64_t lines = 0;
  for (size_t i = 0; i < size; i++) lines += bytes[i] == '\n';
  return lines;
}

/* Takes up to PIECE bytes out of the ring, at most to its wrap; returns their number. The piece may end within a line.
 */
static size_t take(sink *from, char *piece) {
  size_t size = MIN(MIN(from->used, (size_t)PIECE), TCS_LOG_RING - from->first);
  memcpy(piece, from->ring + from->first, size);
  from->first = (from->first + size) % TCS_LOG_RING;
  from->used -= size;
  return size;
}

static int open_file(const sink *to, const char *path) {
  return open(path, O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, to->mode);
}

static void reopen(sink *to) {
  if (!to->path) return;
  const int fd = open_file(to, to->path);
  if (fd >= 0) {
    close(to->fd);
    to->fd = fd;
    return;
  }
  char line[LINE];
  const size_t size =
      format_own(line, TCS_LOG_ERROR, "log.reopen", "text=\"%s; the old file is written on\"", g_strerror(errno));
  (void)write_all(to, line, size);
}

/* Caller holds the mutex, which is released during the write. */
static void write_some(sink *to) {
  char piece[PIECE], line[LINE];
  const size_t size = take(to, piece);
  const uint64_t missing = to->dropped - to->told;
  const bool anew = to->reopen;
  to->reopen = false;
  pthread_mutex_unlock(&to->mutex);
  if (anew) reopen(to);
  bool good = write_all(to, piece, size);
  /* The lost lines belong about here, after those that filled the ring. The notice must not split a line. */
  const bool tell = good && missing && size > 0 && piece[size - 1] == '\n';
  if (tell)
    good = write_all(to, line,
                     format_own(line, TCS_LOG_WARN, "log.lost", "text=\"%" G_GUINT64_FORMAT " lines lost\"", missing));
  pthread_mutex_lock(&to->mutex);
  to->out += size;
  if (tell && good) to->told += missing;
  if (!good) to->dropped += lines_in(piece, size);
  pthread_cond_broadcast(&to->written);
}

static void *log_main(void *user) {
  sink *to = user;
  pthread_setname_np(pthread_self(), to->thread_name);
  pthread_mutex_lock(&to->mutex);
  while (!to->ending || to->used > 0) {
    if (to->used > 0 || to->reopen)
      write_some(to);
    else
      pthread_cond_wait(&to->filled, &to->mutex);
  }
  pthread_mutex_unlock(&to->mutex);
  return NULL;
}

static bool sink_open(sink *to, const char *path, GError **error) {
  const int fd = path ? open_file(to, path) : STDERR_FILENO;
  if (fd < 0) {
    tc_set_error(error, TC_ERROR_IO, NULL, "%s %s: %s", to->option, path, g_strerror(errno));
    return false;
  }
  if (to->path) close(to->fd);
  g_free(to->path);
  to->path = g_strdup(path);
  to->fd = fd;
  return true;
}

static void sink_reopen(sink *to) {
  pthread_mutex_lock(&to->mutex);
  to->reopen = true;
  pthread_cond_signal(&to->filled);
  pthread_mutex_unlock(&to->mutex);
}

static void sink_start(sink *to) {
  pthread_condattr_t clock;
  pthread_condattr_init(&clock);
  pthread_condattr_setclock(&clock, CLOCK_MONOTONIC);
  pthread_cond_init(&to->written, &clock);
  pthread_condattr_destroy(&clock);
  to->ending = false;
  to->running = pthread_create(&to->thread, NULL, log_main, to) == 0;
}

/* Caller holds the mutex. */
static bool wait_written(sink *to, int most_ms) {
  struct timespec until;
  const uint64_t all = to->put;
  clock_gettime(CLOCK_MONOTONIC, &until);
  until.tv_sec += most_ms / 1000;
  until.tv_nsec += most_ms % 1000 * 1000000L;
  if (until.tv_nsec >= 1000000000L) until.tv_sec++, until.tv_nsec -= 1000000000L;
  while (to->running && to->out < all)
    if (pthread_cond_timedwait(&to->written, &to->mutex, &until) == ETIMEDOUT) break;
  return to->out >= all;
}

static bool sink_flush(sink *to, int most_ms) {
  pthread_mutex_lock(&to->mutex);
  const bool written = wait_written(to, most_ms);
  pthread_mutex_unlock(&to->mutex);
  return written;
}

static void sink_stop(sink *to, int most_ms) {
  pthread_mutex_lock(&to->mutex);
  const bool running = to->running, written = wait_written(to, most_ms);
  to->running = running && !written; /* later lines go directly to the file, or with a stuck writer to the ring */
  to->ending = true;
  pthread_cond_signal(&to->filled);
  pthread_mutex_unlock(&to->mutex);
  if (!running) return;
  if (written)
    pthread_join(to->thread, NULL);
  else
    pthread_detach(to->thread);
}

/* --- both sinks ------------------------------------------------------------------------------------- */

bool tcs_log_open(const char *path, GError **error) { return sink_open(&everything, path, error); }

bool tcs_log_open_audit(const char *path, GError **error) {
  audited = path != NULL;
  return !path || sink_open(&audit, path, error);
}

void tcs_log_reopen(void) {
  sink_reopen(&everything);
  if (audited) sink_reopen(&audit);
}

void tcs_log_start(void) {
  sink_start(&everything);
  if (audited) sink_start(&audit);
}

bool tcs_log_flush(int most_ms) {
  const bool written = sink_flush(&everything, most_ms);
  return (!audited || sink_flush(&audit, most_ms)) && written;
}

void tcs_log_stop(int most_ms) {
  sink_stop(&everything, most_ms);
  if (audited) sink_stop(&audit, most_ms);
}
