#include "renderer/import/links.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static char *roots[TC_LINK_ROOTS];
static size_t count;

bool tc_links_set(const char *const *folders, size_t n, GError **error) {
  for (; count > 0; count--) free(roots[count - 1]);
  for (size_t i = 0; i < n; i++) {
    char *real =
        count < TC_LINK_ROOTS && g_file_test(folders[i], G_FILE_TEST_IS_DIR) ? realpath(folders[i], NULL) : NULL;
    if (!real) {
      tc_set_error(error, TC_ERROR_INVALID, NULL, "link root %s: at most %d folders that exist", folders[i],
                   TC_LINK_ROOTS);
      return false;
    }
    roots[count++] = real;
  }
  return true;
}

size_t tc_links_count(void) { return count; }

const char *tc_links_root(size_t i) { return roots[i]; }

static bool lies_in_root(const char *path) {
  for (size_t i = 0; i < count; i++) {
    const size_t n = strlen(roots[i]);
    if (strncmp(path, roots[i], n) == 0 && (path[n] == '/' || path[n] == 0 || roots[i][n - 1] == '/')) return true;
  }
  return false;
}

/* The file stays open while its real path is checked, so a link cannot be changed in between. */
int tc_links_open(int folder_fd, const char *name, int flags) {
  char self[40], path[4096];
  if (count == 0 || name[0] == '/') return -1;
  const int fd = openat(folder_fd, name, O_PATH | O_CLOEXEC);
  if (fd < 0) return -1;
  snprintf(self, sizeof self, "/proc/self/fd/%d", fd);
  const ssize_t length = readlink(self, path, sizeof path - 1);
  path[length > 0 ? length : 0] = 0;
  const bool allowed = length > 0 && lies_in_root(path);
  const int opened = !allowed ? -1 : flags & O_PATH ? fd : open(self, flags | O_CLOEXEC);
  if (opened != fd) close(fd);
  return opened;
}
