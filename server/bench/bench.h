/* What measures the renderer: sub-commands of the same binary that the daemon knows nothing of. As in server/cli/cli.h,
 * each takes its own argv and returns the exit code. */
#ifndef TC_SERVER_BENCH_H
#define TC_SERVER_BENCH_H

int tcs_bench(int argc, char **argv);  /* frame times of every kernel variant and their errors */
int tcs_report(int argc, char **argv); /* error against run time, over scenes and settings */

#endif
