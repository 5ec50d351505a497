/* Measurements of the renderer: sub-commands of the same binary, which the daemon never includes. As in
 * server/cli/cli.h, each takes its own argv and returns the exit code. */
#ifndef TC_SERVER_BENCH_H
#define TC_SERVER_BENCH_H

int tcs_bench(int argc, char **argv); /* frame times and errors of every kernel variant */
int tcs_report(int argc, char **argv); /* error against run time, over scenes and settings */

#endif
