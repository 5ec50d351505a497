/* Inputs: files and memory by offset, and files beside them. */
#include "renderer/import/decode.h"
#include "renderer/import/reader.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/openat2.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

/* How much of a file is looked at for its first decoded bytes. */
#define HEAD_REACH (1u << 20)

/* Takes over fd. A FIFO or a device would hang or never end, so only regular files pass. */
static bool adopt(tc_input *input, int fd, const char *name, GError **error) {
  struct stat st;
  *input = (tc_input){.fd = fd, .folder_fd = -1, .name = g_strdup(name)};
  if (fstat(fd, &st) == 0 && S_ISREG(st.st_mode)) {
    input->size = (uint64_t)st.st_size;
    return true;
  }
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "not a regular file");
  tc_input_close(input);
  return false;
}

bool tc_input_open(tc_input *input, const char *path, GError **error) {
  *input = (tc_input){.fd = -1, .folder_fd = -1};
  int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  if (fd < 0) {
    int code = errno == ENOENT || errno == ENOTDIR ? TC_ERROR_NOT_FOUND : TC_ERROR_IO;
    tc_set_error(error, code, NULL, "%s", g_strerror(errno));
    return false;
  }
  char *name = g_path_get_basename(path), *folder = g_path_get_dirname(path);
  bool ok = adopt(input, fd, name, error);
  if (ok) input->folder_fd = open(folder, O_RDONLY | O_CLOEXEC | O_DIRECTORY);
  g_free(folder);
  g_free(name);
  return ok;
}

void tc_input_memory(tc_input *input, const void *bytes, size_t size, int folder_fd, const char *name) {
  int copy = folder_fd < 0 ? -1 : fcntl(folder_fd, F_DUPFD_CLOEXEC, 0);
  *input = (tc_input){.fd = -1, .bytes = bytes, .size = size, .folder_fd = copy, .name = g_strdup(name)};
}

void tc_input_close(tc_input *input) {
  /* a zeroed input has fd 0, which is never ours */
  if (input->fd > 0) close(input->fd);
  if (input->folder_fd > 0) close(input->folder_fd);
  g_free(input->name);
  *input = (tc_input){.fd = -1, .folder_fd = -1};
}

static bool stays_beside(const char *name) {
  if (name[0] == '\0' || name[0] == '/' || strchr(name, '\\')) return false;
  char **parts = g_strsplit(name, "/", -1);
  bool inside = true;
  for (char **part = parts; *part; part++)
    if (strcmp(*part, "..") == 0) inside = false;
  g_strfreev(parts);
  return inside;
}

/* The kernel itself keeps links from leading out of the folder. Where it is too old or a filter forbids the call,
 * only a plain name that is no link is opened. */
static int open_beneath(int folder_fd, const char *name) {
  struct open_how how = {.flags = O_RDONLY | O_CLOEXEC | O_NONBLOCK,
                         .resolve = RESOLVE_BENEATH | RESOLVE_NO_MAGICLINKS};
  int fd = (int)syscall(SYS_openat2, folder_fd, name, &how, sizeof how);
  if (fd < 0 && (errno == ENOSYS || errno == EPERM) && !strchr(name, '/'))
    fd = openat(folder_fd, name, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOFOLLOW);
  return fd;
}

bool tc_input_may_name(const tc_input *input, GError **error) {
  if (!input->alone) return true;
  tc_set_error(error, TC_ERROR_FORMAT, NULL, "the header names another file; upload header and voxels as one");
  return false;
}

bool tc_input_open_sibling(const tc_input *input, const char *name, tc_input *sibling, GError **error) {
  *sibling = (tc_input){.fd = -1, .folder_fd = -1};
  if (!tc_input_may_name(input, error)) return false;
  char *quoted = tc_text_quote(name);
  bool ok = false;
  if (!stays_beside(name)) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "data file %s: must lie beside its header, named without a path",
                 quoted);
  } else if (input->folder_fd < 0) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "data file %s: a header alone cannot be opened, its data are needed",
                 quoted);
  } else {
    int fd = open_beneath(input->folder_fd, name);
    if (fd < 0) {
      bool missing = errno == ENOENT || errno == ENOTDIR;
      tc_set_error(error, missing ? TC_ERROR_FORMAT : TC_ERROR_IO, NULL, "data file %s: %s", quoted,
                   missing ? "missing, put it beside the header" : g_strerror(errno));
    } else {
      ok = adopt(sibling, fd, name, error);
      if (!ok) g_prefix_error(error, "data file %s: ", quoted);
    }
  }
  g_free(quoted);
  return ok;
}

bool tc_input_read(const tc_input *input, uint64_t offset, void *to, size_t n, GError **error) {
  if (n == 0) return true;
  if (offset > input->size || n > input->size - offset) {
    tc_set_error(error, TC_ERROR_FORMAT, NULL, "file ends at byte %" G_GUINT64_FORMAT ", before its data do",
                 input->size);
    return false;
  }
  if (input->fd < 0) {
    memcpy(to, input->bytes + offset, n);
    return true;
  }
  for (size_t done = 0; done < n;) {
    ssize_t got = pread(input->fd, (char *)to + done, n - done, (off_t)(offset + done));
    if (got < 0 && errno == EINTR) continue;
    if (got <= 0) {
      tc_set_error(error, TC_ERROR_IO, NULL, "reading failed: %s",
                   got < 0 ? g_strerror(errno) : "the file was cut short");
      return false;
    }
    done += (size_t)got;
  }
  return true;
}

bool tc_input_head(const tc_input *input, void *to, size_t n, size_t *got, bool *gzip, GError **error) {
  uint8_t magic[2] = {0};
  *got = 0;
  *gzip = false;
  if (input->size >= 2 && !tc_input_read(input, 0, magic, 2, error)) return false;
  *gzip = magic[0] == 0x1f && magic[1] == 0x8b;
  tc_encoding encoding = *gzip ? TC_ENCODING_DEFLATE : TC_ENCODING_RAW;
  /* Gzip members that hold nothing may follow each other for as long as the file is. */
  tc_input start = *input;
  start.size = MIN(start.size, (uint64_t)HEAD_REACH);
  tc_decoder *decoder = tc_decoder_new(&start, 0, encoding, TC_ELEMENT_U8, 0, error);
  if (!decoder) return false;
  bool ok = true;
  GError *trouble = NULL;
  for (size_t more = 1; *got < n && more > 0; *got += more)
    if (!tc_decoder_read(decoder, (char *)to + *got, n - *got, &more, &trouble)) {
      more = 0;
      ok = g_error_matches(trouble, TC_ERROR, TC_ERROR_FORMAT);
      break;
    }
  tc_decoder_free(decoder);
  if (ok)
    g_clear_error(&trouble);
  else
    g_propagate_error(error, trouble);
  return ok;
}
