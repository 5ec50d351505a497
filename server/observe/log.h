/* Log lines, on stderr or in a file: `TIME LEVEL event key=value ...`.
 *
 * A caller never waits: lines go into a ring of TCS_LOG_RING bytes, a thread of the log's own writes them. While nobody
 * takes them (a full pipe, a full disk) lines that find no room are dropped and counted, and the log says how many once
 * it flows again. Before tcs_log_start() and after tcs_log_stop() lines are written at once.
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

/* Appends to the file `path` from now on, made where there is none; NULL: stderr. Before tcs_log_start(). */
bool tcs_log_open(const char *path, GError **error);
/* Lines whose event begins with "audit." go to the file `path` too, whatever the level: a file that only the server's
 * user reads, with a ring and a thread of its own. NULL: there is none. Before tcs_log_start(). */
bool tcs_log_open_audit(const char *path, GError **error);
/* Opens the files anew, after somebody moved them away; nothing on stderr. Done by the log's thread: does not wait. */
void tcs_log_reopen(void);

/* Starts the log's thread, which inherits the caller's signal mask. Without it (no thread to be had) lines are written
 * by whoever logs them. */
void tcs_log_start(void);
/* Waits, up to a limit, until all lines logged so far are written. False: some are not. */
bool tcs_log_flush(int most_ms);
/* Flushes and ends the thread; one that hangs in a write is left behind. */
void tcs_log_stop(int most_ms);
/* Lines that were dropped since the start. */
uint64_t tcs_log_dropped(void);

/* `format` gives the key=value part, or is NULL. Control characters in it become spaces. */
void tcs_log(tcs_log_level level, const char *event, const char *format, ...) G_GNUC_PRINTF(3, 4);

#endif
