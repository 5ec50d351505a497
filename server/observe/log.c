#include "server/observe/log.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static const char *const level_names[TCS_LOG_LEVEL_COUNT] = {"debug", "info", "warn", "error"};
static tcs_log_level threshold = TCS_LOG_INFO;

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

void tcs_log(tcs_log_level level, const char *event, const char *format, ...) {
  if (level < threshold) return;
  struct timespec now;
  struct tm utc;
  clock_gettime(CLOCK_REALTIME, &now);
  gmtime_r(&now.tv_sec, &utc);
  char line[1024];
  size_t used = strftime(line, sizeof line, "%Y-%m-%dT%H:%M:%S", &utc);
  used += (size_t)snprintf(line + used, sizeof line - used, ".%03ldZ %s %s%s", now.tv_nsec / 1000000,
                           level_names[level], event, format ? " " : "");
  if (format) {
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(line + used, sizeof line - used - 1, format, arguments);
    va_end(arguments);
    for (char *c = line + used; *c; c++)
      if ((unsigned char)*c < 0x20 || *c == 0x7f) *c = ' ';
  }
  const size_t length = strlen(line);
  line[length] = '\n';
  if (write(STDERR_FILENO, line, length + 1) < 0) return; /* nowhere left to say so */
}
