#include "renderer/import/beside.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include "renderer/import/links.h"
#include "renderer/import/reader.h"

static bool stays_beside(const char *name) {
  if (name[0] == '\0' || name[0] == '/' || strchr(name, '\\')) return false;
  char **parts = g_strsplit(name, "/", -1);
  bool inside = true;
  for (char **part = parts; *part; part++)
    if (strcmp(*part, "..") == 0) inside = false;
  g_strfreev(parts);
  return inside;
}

/* openat2() makes the kernel refuse links that lead out of the folder. Where the kernel is too old or a seccomp
 * filter forbids the call, only a plain name that is not a link is opened. */
static int open_beneath(int folder_fd, const char *name) {
  struct open_how how = {.flags = O_RDONLY | O_CLOEXEC | O_NONBLOCK,
                         .resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS};
  int fd = (int)syscall(SYS_openat2, folder_fd, name, &how, sizeof how);
  if (fd < 0 && (errno == ENOSYS || errno == EPERM) && !strchr(name, '/'))
    fd = openat(folder_fd, name, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
  return fd < 0 && errno != ENOENT ? tc_links_open(folder_fd, name, O_RDONLY | O_NONBLOCK) : fd;
}

int tc_beside_open(int folder_fd, const char *name, GError **error) {
  struct stat st;
  char *quoted = tc_text_quote(name);
  int fd = -1;
  if (!stays_beside(name)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "data file %s: must lie beside its header, named without a path", quoted);
  } else if ((fd = open_beneath(folder_fd, name)) < 0) {
    const bool missing = errno == ENOENT || errno == ENOTDIR;
    tc_set_error(error, missing ? TC_ERROR_FORMAT : TC_ERROR_IO, NULL, "data file %s: %s", quoted,
                 missing ? "missing, put it beside the header" : g_strerror(errno));
  } else if (fstat(fd, &st) != 0 || !S_ISREG(st.st_mode)) { /* opening a FIFO or a device could block or never end */
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "data file %s: not a regular file", quoted);
    close(fd);
    fd = -1;
  }
  g_free(quoted);
  return fd;
}
