/* A file being written. Private to export/. */
#ifndef TC_EXPORT_OUTPUT_H
#define TC_EXPORT_OUTPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <zlib.h>

#include "renderer/base/error.h"

typedef struct tc_output {
  char *path;
  bool replaces; /* the finished file replaces `path`; else `path` is a device or link and is written to */
  char *part;    /* temporary name in the same folder; NULL: none yet */
  int descriptor;    /* owned; `file` writes to a duplicate of it */
  gzFile file;
  bool good; /* no failure so far; after a failure, writes do nothing */
} tc_output;

/* Returns false with TC_ERROR_IO; tc_output_end() must not be called then. */
bool tc_output_begin(tc_output *output, const char *path, bool gzip, GError **error);
void tc_output_write(tc_output *output, const void *bytes, size_t size);
void tc_output_print(tc_output *output, const char *format, ...) G_GNUC_PRINTF(2, 3);
/* Everything written from here on is compressed. */
void tc_output_compress(tc_output *output);
/* Gives the file its final name, or removes it after a failure. */
bool tc_output_end(tc_output *output, GError **error);

bool tc_path_ends(const char *path, const char *ending); /* case-insensitive */

#endif
