#include "server/memory/machine.h"

#include <glib.h>
#include <stdbool.h>
#include <string.h>

static char *read_text(const char *root, const char *path, const char *name) {
  char *full = g_build_filename(*root ? root : "/", path, name, NULL), *text = NULL;
  if (!g_file_get_contents(full, &text, NULL, NULL)) text = NULL;
  g_free(full);
  return text;
}

/* The number in a control file; "max", a missing file or an invalid number is no limit. */
static uint64_t limit_in(const char *root, const char *group, const char *name) {
  char *text = read_text(root, group, name), *end = NULL;
  const uint64_t value = text ? g_ascii_strtoull(text, &end, 10) : 0;
  const bool is_number = text && end != text;
  g_free(text);
  return is_number && value ? value : UINT64_MAX;
}

/* The least limit of a group and its parents. Inside a container the file system may have the process's group at the
 * top, under a different path than /proc reports: groups that do not exist are skipped. */
static uint64_t least_upwards(const char *root, const char *mount, const char *path, const char *const *names) {
  uint64_t least = UINT64_MAX;
  char *group = g_strdup(path);
  for (;;) {
    char *folder = g_build_filename(mount, group, NULL);
    for (const char *const *name = names; *name; name++) least = MIN(least, limit_in(root, folder, *name));
    g_free(folder);
    char *slash = strrchr(group, '/');
    if (!slash) break;
    *slash = 0;
  }
  g_free(group);
  return least;
}

/* One line of /proc/self/cgroup, NUMBER:CONTROLLERS:PATH; a line without controllers is version 2. */
static uint64_t limit_of_line(const char *root, const char *line) {
  static const char *const second[] = {"memory.max", "memory.high", NULL}, *const first[] = {"memory.limit_in_bytes",
                                                                                             NULL};
  char **parts = g_strsplit(line, ":", 3);
  uint64_t least = UINT64_MAX;
  if (g_strv_length(parts) == 3) {
    char **controllers = g_strsplit(parts[1], ",", -1);
    if (!*parts[1]) {
      least = least_upwards(root, "/sys/fs/cgroup", parts[2], second);
      least = MIN(least, least_upwards(root, "/sys/fs/cgroup/unified", parts[2], second));
    } else if (g_strv_contains((const char *const *)controllers, "memory")) {
      least = least_upwards(root, "/sys/fs/cgroup/memory", parts[2], first);
    }
    g_strfreev(controllers);
  }
  g_strfreev(parts);
  return least;
}

static uint64_t installed(const char *root) {
  char *text = read_text(root, "/proc", "meminfo");
  const char *line = text ? strstr(text, "MemTotal:") : NULL;
  const uint64_t kib = line ? g_ascii_strtoull(line + strlen("MemTotal:"), NULL, 10) : 0;
  g_free(text);
  return kib && kib < UINT64_MAX / 1024 ? kib * 1024 : UINT64_MAX;
}

uint64_t tcs_machine_memory(const char *root) {
  uint64_t least = installed(root);
  char *text = read_text(root, "/proc/self", "cgroup");
  char **lines = g_strsplit(text ? text : "", "\n", -1);
  for (char **line = lines; *line; line++) least = MIN(least, limit_of_line(root, *line));
  g_strfreev(lines);
  g_free(text);
  return least == UINT64_MAX ? 0 : least;
}
