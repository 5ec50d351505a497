/* Signal handling on a thread of its own, so that signals work while the I/O thread is busy.
 *
 * SIGTERM and SIGINT end the daemon: the I/O thread sees the first one here and drains. If the process still runs
 * `most_ms` later, this thread ends it. A second signal shortens the wait to TCS_SIGNALS_SECOND_MS. SIGHUP reopens the
 * log; the I/O thread does the rest. */
#ifndef TCS_CLI_SIGNALS_H
#define TCS_CLI_SIGNALS_H

#include <stdbool.h>

#include "renderer/base/error.h"

#define TCS_SIGNALS_SECOND_MS 1000

typedef struct tcs_signals tcs_signals;

/* Blocks the signals for the calling thread and the threads it starts from now on, so call it before starting any. */
tcs_signals *tcs_signals_new(int64_t most_ms, GError **error);
void tcs_signals_free(tcs_signals *signals);    /* NULL is fine */
int tcs_signals_fd(const tcs_signals *signals); /* an eventfd, readable after a signal */
int tcs_signals_ends(tcs_signals *signals);     /* number of SIGTERM and SIGINT so far; resets the eventfd */
bool tcs_signals_hung_up(tcs_signals *signals); /* whether SIGHUP came since the last call */

#endif
