/* The daemon of `tomocast serve` as open, turn and close: for the command, and for tests that drive a daemon in their
 * own thread. One at a time per process, since it handles SIGTERM, SIGINT and SIGHUP. */
#ifndef TCS_CLI_DAEMON_H
#define TCS_CLI_DAEMON_H

#include "server/server.h"

typedef struct tcs_daemon tcs_daemon;

/* Starts a daemon with the arguments of `tomocast serve`; on return it listens. NULL on an error, which was printed to
 * stderr; *code is the exit code. */
tcs_daemon *tcs_daemon_open(int argc, char **argv, int *code);
/* One turn of the event loop, which waits for at most `most_ms` milliseconds. False: the daemon drained after a signal
 * and has nothing left to do. */
bool tcs_daemon_turn(tcs_daemon *daemon, int most_ms);
tcs_server *tcs_daemon_server(tcs_daemon *daemon);
void tcs_daemon_close(tcs_daemon *daemon); /* at any time, also before it drained */

#endif
