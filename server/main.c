/* The single binary: dispatches to a sub-command. */
#include <locale.h>
#include <stdio.h>
#include <string.h>

#include "server/bench/bench.h"
#include "server/cli/cli.h"
#include "server/encode/encode.h"

typedef struct command {
  const char *name;
  int (*run)(int argc, char **argv);
  const char *arguments, *summary;
} command;

static const command commands[] = {
    {"serve", tcs_cli_serve, "[OPTION...]", "the daemon; http://127.0.0.1:8080 unless told otherwise"},
    {"render", tcs_cli_render, "VOLUME [OPTION...]", "one picture, no server"},
    {"info", tcs_cli_info, "VOLUME [--json]", "what a volume file holds"},
    {"convert", tcs_cli_convert, "IN OUT [--iso V]", "a volume to another format, or its surface to a mesh"},
    {"bench", tcs_bench, "[VOLUME...]", "frame times and errors of every kernel variant"},
    {"report", tcs_report, "--output DIR", "error against run time, over scenes and settings"},
};

static void print_help(void) {
  puts("usage: tomocast COMMAND [OPTION...]\n");
  for (size_t i = 0; i < G_N_ELEMENTS(commands); i++)
    printf("  %-7s %-19s %s\n", commands[i].name, commands[i].arguments, commands[i].summary);
  puts("\n  --version  name and version\n  --help     this; each command has its own --help\n\n"
       "VOLUME is NIfTI, NRRD, MetaImage or DICOM (a folder, a file, a zip), or demo:NAME.\n"
       "Exit codes: 0 done, 1 failed, 2 bad usage. Not for diagnostic use.");
}

static int refuse(const char *what, const char *name) {
  fprintf(stderr, "tomocast: %s%s; known:", what, name);
  for (size_t i = 0; i < G_N_ELEMENTS(commands); i++) fprintf(stderr, "%s %s", i ? "," : "", commands[i].name);
  fputs(" (see tomocast --help)\n", stderr);
  return TCS_EXIT_USAGE;
}

int main(int argc, char **argv) {
  setlocale(LC_CTYPE, ""); /* file names and messages in the user's character set; numbers stay in C format */
  tcs_encode_prepare_process();
  if (argc < 2) return refuse("a sub-command expected", "");
  const char *name = argv[1];
  if (strcmp(name, "--version") == 0 || strcmp(name, "-V") == 0) {
    puts("tomocast " TC_VERSION);
    return TCS_EXIT_DONE;
  }
  if (strcmp(name, "--help") == 0 || strcmp(name, "-h") == 0 || strcmp(name, "help") == 0) {
    print_help();
    return TCS_EXIT_DONE;
  }
  for (size_t i = 0; i < G_N_ELEMENTS(commands); i++)
    if (strcmp(commands[i].name, name) == 0) return commands[i].run(argc - 1, argv + 1);
  return refuse(*name == '-' ? "unknown option " : "unknown sub-command ", name);
}
