/* The daemon of `tomocast serve`, opened, run turn by turn and closed: for the command itself, and for tests that drive
 * one in their own thread. One at a time in a process: it takes SIGTERM, SIGINT and SIGHUP. */
#ifndef TCS_CLI_DAEMON_H
#define TCS_CLI_DAEMON_H

#include "server/server.h"

typedef struct tcs_daemon tcs_daemon;

/* As `tomocast serve` with these arguments: it listens. NULL: it does not; said on stderr, *code is the exit code. */
tcs_daemon *tcs_daemon_open(int argc, char **argv, int *code);
/* One turn of the loop, which waits for at most `most_ms` milliseconds. False: SIGTERM came and everything has ended.
 */
bool tcs_daemon_turn(tcs_daemon *daemon, int most_ms);
tcs_server *tcs_daemon_server(tcs_daemon *daemon);
void tcs_daemon_close(tcs_daemon *daemon); /* at any time */

#endif
