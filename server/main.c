/* tomocast: one binary, sub-commands. */
#include <stdio.h>
#include <string.h>

#include "server/cli/cli.h"
#include "server/encode/encode.h"

static const struct { const char *name; int (*run)(int argc, char **argv); const char *does; } commands[] = {
    {"serve", tcs_cli_serve, "the daemon"},
    {"render", tcs_cli_render, "one picture, no server"},
    {"info", tcs_cli_info, "what a volume file holds"},
};

static int usage(FILE *to, int code) {
  fprintf(to, "usage: tomocast COMMAND ...\n");
  for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
    fprintf(to, "  %-8s %s\n", commands[i].name, commands[i].does);
  fprintf(to, "tomocast COMMAND --help tells more\n");
  return code;
}

int main(int argc, char **argv) {
  tcs_encode_prepare_process();
  if (argc < 2) return usage(stderr, TCS_EXIT_USAGE);
  if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "help") == 0) return usage(stdout, TCS_EXIT_DONE);
  if (strcmp(argv[1], "--version") == 0) {
    printf("tomocast %s\n", TC_VERSION);
    return TCS_EXIT_DONE;
  }
  for (size_t i = 0; i < sizeof commands / sizeof commands[0]; i++)
    if (strcmp(argv[1], commands[i].name) == 0) return commands[i].run(argc - 1, argv + 1);
  fprintf(stderr, "tomocast %s: no such command; see tomocast --help\n", argv[1]);
  return TCS_EXIT_USAGE;
}
