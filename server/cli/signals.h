/* Signals, heard by a thread of their own, whatever the I/O thread does at the time.
 *
 * SIGTERM and SIGINT end the daemon: the first is a wish, which the I/O thread reads here and fulfils; what has not
 * ended `most_ms` later is left as it is. After a second one the daemon has TCS_SIGNALS_SECOND_MS. SIGHUP opens the log
 * anew; what else it means is the I/O thread's. */
#ifndef TCS_CLI_SIGNALS_H
#define TCS_CLI_SIGNALS_H

#include <stdbool.h>

#include "renderer/base/error.h"

#define TCS_SIGNALS_SECOND_MS 1000

typedef struct tcs_signals tcs_signals;

/* Blocks the signals for the calling thread and all it starts from now on: call before any other. */
tcs_signals *tcs_signals_new(int64_t most_ms, GError **error);
void tcs_signals_free(tcs_signals *signals);    /* NULL is fine */
int tcs_signals_fd(const tcs_signals *signals); /* an eventfd, readable when a signal was heard */
int tcs_signals_ends(tcs_signals *signals);     /* wishes to end heard so far; the eventfd is quiet then */
bool tcs_signals_hung_up(tcs_signals *signals); /* SIGHUP was heard since the last call */

#endif
