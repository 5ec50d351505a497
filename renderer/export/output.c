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

/* A file without a name vanishes with an interrupted process. On file systems without such files the part has a temporary
 * name. */
static void open_part(tc_output *o) {
  char *within = g_path_get_dirname(o->path);
  o->descriptor = open(within, O_TMPFILE | O_WRONLY | O_CLOEXEC, 0666);
  g_free(within);
  if (o->descriptor >= 0) return;
  o->part = g_strconcat(o->path, ".XXXXXX", NULL);
  o->descriptor = g_mkstemp_full(o->part, O_WRONLY | O_CLOEXEC, 0666);
}

/* Gives a nameless file a temporary name: linkat() cannot replace the older file, rename() can. */
static bool name_part(tc_output *o) {
  char from[40];
  g_snprintf(from, sizeof from, "/proc/self/fd/%d", o->descriptor);
  for (int tries = 0; tries < 100; tries++) {
    g_free(o->part);
    o->part = g_strdup_printf("%s.%06x", o->path, g_random_int() & 0xffffff);
    if (linkat(AT_FDCWD, from, AT_FDCWD, o->part, AT_SYMLINK_FOLLOW) == 0) return true;
    if (errno != EEXIST) break;
  }
  g_clear_pointer(&o->part, g_free);
  return false;
}

bool tc_output_begin(tc_output *o, const char *path, bool gzip, GError **error) {
  *o = (tc_output){.path = g_strdup(path), .replaces = !is_special(path), .good = true};
  if (o->replaces)
    open_part(o);
  else
    o->descriptor = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
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
  if (good && o->replaces && !o->part) good = name_part(o);
  if (good && o->replaces) good = g_rename(o->part, o->path) == 0;
  if (close(o->descriptor)) good = false;
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
