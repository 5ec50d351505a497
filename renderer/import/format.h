/* The formats, one file each: probe by the first bytes, read from an input. */
#ifndef TC_IMPORT_FORMAT_H
#define TC_IMPORT_FORMAT_H

#include "renderer/import/import.h"
#include "renderer/import/source.h"

/* How many first bytes (inflated when the file is gzip) the probes want to see. */
#define TC_PROBE_BYTES 4096

typedef struct tc_format {
  const char *name;
  const char *suffixes; /* "|"-separated, lower case; decides only where the content does not */
  bool compressed;      /* the whole file may be gzip */
  bool (*probe)(const uint8_t *head, size_t size);
  /* Reads the first frame. The input stays the caller's. options may be NULL. Any thread. */
  tc_volume *(*read)(const tc_input *input, const tc_import_options *options, GError **error);
} tc_format;

extern const tc_format tc_format_nifti, tc_format_nrrd, tc_format_metaimage;

#endif
