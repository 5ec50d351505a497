/* Log lines on stderr: `TIME LEVEL event key=value ...`, one line and one write each.
 *
 * Never patient data: no volume names, file names, paths, query strings or header values. Any thread. */
#ifndef TCS_OBSERVE_LOG_H
#define TCS_OBSERVE_LOG_H

#include <glib.h>

typedef enum tcs_log_level {
  TCS_LOG_DEBUG,
  TCS_LOG_INFO,
  TCS_LOG_WARN,
  TCS_LOG_ERROR,
  TCS_LOG_LEVEL_COUNT
} tcs_log_level;

/* Lines below `level` are dropped; set once, before threads start. The default is TCS_LOG_INFO. */
void tcs_log_set_level(tcs_log_level level);
/* Name ("debug" ...) to level; false: no such name. */
gboolean tcs_log_level_parse(const char *name, tcs_log_level *level);

/* `format` gives the key=value part, or is NULL. Control characters in it become spaces. */
void tcs_log(tcs_log_level level, const char *event, const char *format, ...) G_GNUC_PRINTF(3, 4);

#endif
