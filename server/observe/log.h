/* Log lines, on stderr or in a file: `TIME LEVEL event key=value ...`.
 *
 * Logging never blocks the caller: lines go into a ring of TCS_LOG_RING bytes, which the log's thread writes out. If
 * the output blocks (full pipe, full disk) until the ring is full, further lines are dropped and counted, and the log
 * reports the count once the output accepts lines again. Before tcs_log_start() and after tcs_log_stop() lines are
 * written directly.
 *
 * Never patient data: no volume names, file names, paths, query strings or header values. Any thread. */
#ifndef TCS_OBSERVE_LOG_H
#define TCS_OBSERVE_LOG_H

#include <glib.h>
#include <stdbool.h>
#include <stdint.h>

typedef enum tcs_log_level {
  TCS_LOG_DEBUG,
  TCS_LOG_INFO,
  TCS_LOG_WARN,
  TCS_LOG_ERROR,
  TCS_LOG_LEVEL_COUNT
} tcs_log_level;

#define TCS_LOG_RING 262144

/* Lines below `level` are dropped; set once, before threads start. The default is TCS_LOG_INFO. */
void tcs_log_set_level(tcs_log_level level);
/* Name ("debug" ...) to level; false: no such name. */
gboolean tcs_log_level_parse(const char *name, tcs_log_level *level);

/* Appends to the file `path` from now on, created if missing; NULL: stderr. Before tcs_log_start(). */
bool tcs_log_open(const char *path, GError **error);
/* Also writes lines whose event begins with "audit." to the file `path`, at every level. The file is readable by the
 * server's user only and has its own ring and thread. NULL: no audit file. Before tcs_log_start(). */
bool tcs_log_open_audit(const char *path, GError **error);
/* Reopens the files after log rotation; no effect on stderr. Does not wait: the log's thread does it. */
void tcs_log_reopen(void);

/* Starts the log's thread, which inherits the caller's signal mask. If no thread can be created, the callers go on
 * writing directly. */
void tcs_log_start(void);
/* Waits up to most_ms until all lines logged so far are written. False: some are not. */
bool tcs_log_flush(int most_ms);
/* Flushes and joins the thread; after most_ms a thread stuck in a write is detached. */
void tcs_log_stop(int most_ms);
/* Number of lines dropped since the start. */
uint64_t tcs_log_dropped(void);

/* `format` makes the key=value part; NULL: none. Control characters in it become spaces. */
void tcs_log(tcs_log_level level, const char *event, const char *format, ...) G_GNUC_PRINTF(3, 4);

#endif
