#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "renderer/base/error.h"
#include "server/cli/cli.h"

bool tcs_cli_parse(const tcs_cli_usage *usage, int argc, char **argv, char ***rest, GError **error) {
  const GOptionEntry others[] = {{G_OPTION_REMAINING, 0, 0, G_OPTION_ARG_FILENAME_ARRAY, rest, NULL, usage->arguments},
                                 {0}};
  char *program = g_strconcat("tomocast ", usage->command, NULL);
  GOptionContext *context = g_option_context_new(NULL);
  *rest = NULL;
  g_set_prgname(program);
  g_option_context_set_summary(context, usage->summary);
  g_option_context_add_main_entries(context, usage->entries, NULL);
  g_option_context_add_main_entries(context, others, NULL);
  bool good = g_option_context_parse(context, &argc, &argv, error);
  if (!good) g_prefix_error(error, "options, see %s --help: ", program);
  g_option_context_free(context);
  g_free(program);
  return good;
}

int tcs_cli_fail(const char *command, int code, GError *error) {
  char *line = g_strdup(error ? error->message : "failed");
  for (char *c = line; *c; c++)
    if (*c == '\n' || *c == '\r') *c = ' ';
  fprintf(stderr, "tomocast %s: %s\n", command, line);
  g_free(line);
  g_clear_error(&error);
  return code;
}

bool tcs_cli_read_text(const char *path, size_t limit, char **text, size_t *size, GError **error) {
  bool from_stdin = strcmp(path, "-") == 0;
  FILE *file = from_stdin ? stdin : fopen(path, "rb");
  if (!file) {
    tc_set_error(error, TC_ERROR_IO, NULL, "open %s: %s", path, g_strerror(errno));
    return false;
  }
  GString *all = g_string_new(NULL);
  char block[65536];
  size_t got;
  while (all->len <= limit && (got = fread(block, 1, sizeof block, file)) > 0)
    g_string_append_len(all, block, (gssize)got);
  bool good = !ferror(file) && all->len <= limit;
  if (ferror(file))
    tc_set_error(error, TC_ERROR_IO, NULL, "read %s: %s", path, g_strerror(errno));
  else if (!good)
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "%s: longer than %zu bytes", path, limit);
  if (!from_stdin) fclose(file);
  *size = all->len;
  *text = g_string_free(all, !good);
  return good;
}
