/* A file in the making. Private to export/. */
#ifndef TC_EXPORT_OUTPUT_H
#define TC_EXPORT_OUTPUT_H

#include <stdbool.h>
#include <stddef.h>
#include <zlib.h>

#include "renderer/base/error.h"

typedef struct tc_output {
  char *path, *part; /* the name it gets, and the one it has meanwhile, beside it */
  int descriptor;    /* the file's own; what `file` writes to is a copy of it */
  gzFile file;
  bool good; /* so far; what is written after a failure is left out */
} tc_output;

/* False: TC_ERROR_IO, and nothing to end. */
bool tc_output_begin(tc_output *output, const char *path, bool gzip, GError **error);
void tc_output_write(tc_output *output, const void *bytes, size_t size);
void tc_output_print(tc_output *output, const char *format, ...) G_GNUC_PRINTF(2, 3);
/* What follows is compressed. */
void tc_output_compress(tc_output *output);
/* Gives the file its name, or takes it away. */
bool tc_output_end(tc_output *output, GError **error);

bool tc_path_ends(const char *path, const char *ending); /* in any case */

#endif
