#include "renderer/export/output.h"

#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <stdarg.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "renderer/export/export.h"

#define WRITE_AT_ONCE (64u << 20) /* gzwrite() takes an unsigned int */

bool tc_path_ends(const char *path, const char *ending) {
  size_t size = strlen(path), n = strlen(ending);
  return size > n && g_ascii_strcasecmp(path + size - n, ending) == 0;
}

static bool fail(tc_output *o, const char *what, GError **error) {
  tc_set_error(error, TC_ERROR_IO, NULL, "%s %s: %s", what, o->path, g_strerror(errno));
  g_free(o->path);
  g_free(o->part);
  return false;
}

static bool open_stream(tc_output *o, const char *mode) {
  int copy = dup(o->descriptor);
  o->file = copy >= 0 ? gzdopen(copy, mode) : NULL;
  if (!o->file && copy >= 0) close(copy);
  return o->file != NULL;
}

/* A device, a pipe or a link, such as /dev/stdout, is written to; renaming would replace it. */
static bool is_special(const char *path) {
  struct stat facts;
  return lstat(path, &facts) == 0 && !S_ISREG(facts.st_mode) && !S_ISDIR(facts.st_mode);
}

bool tc_output_begin(tc_output *o, const char *path, bool gzip, GError **error) {
  *o = (tc_output){.path = g_strdup(path), .good = true};
  if (!is_special(path)) o->part = g_strconcat(path, ".XXXXXX", NULL);
  o->descriptor = o->part ? g_mkstemp_full(o->part, O_WRONLY, 0666) : open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
  if (o->descriptor >= 0 && open_stream(o, gzip ? "wb6" : "wbT")) return true;
  if (o->descriptor >= 0) {
    close(o->descriptor);
    if (o->part) g_unlink(o->part);
  }
  return fail(o, "create", error);
}

void tc_output_compress(tc_output *o) {
  o->good = gzclose(o->file) == Z_OK && o->good;
  o->good = open_stream(o, "wb6") && o->good;
}

void tc_output_write(tc_output *o, const void *bytes, size_t size) {
  for (const char *at = bytes; o->good && size > 0;) {
    unsigned n = (unsigned)MIN(size, WRITE_AT_ONCE);
    o->good = gzwrite(o->file, at, n) == (int)n;
    at += n, size -= n;
  }
}

void tc_output_print(tc_output *o, const char *format, ...) {
  va_list args;
  va_start(args, format);
  char *text = g_strdup_vprintf(format, args);
  va_end(args);
  tc_output_write(o, text, strlen(text));
  g_free(text);
}

bool tc_output_end(tc_output *o, GError **error) {
  int reason = o->good ? 0 : errno;
  bool good = o->file && gzclose(o->file) == Z_OK && o->good;
  good = close(o->descriptor) == 0 && good;
  if (good && o->part) good = g_rename(o->part, o->path) == 0;
  if (!good) {
    int later = errno;
    if (o->part) g_unlink(o->part);
    errno = reason ? reason : later;
    return fail(o, "write", error);
  }
  g_free(o->path);
  g_free(o->part);
  return true;
}

bool tc_export_bytes(const void *bytes, size_t size, const char *path, GError **error) {
  tc_output o;
  if (!tc_output_begin(&o, path, false, error)) return false;
  tc_output_write(&o, bytes, size);
  return tc_output_end(&o, error);
}
