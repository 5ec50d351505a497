/* The formats, one file each: recognised by their first bytes, read from an input. */
#ifndef TC_IMPORT_FORMAT_H
#define TC_IMPORT_FORMAT_H

#include "renderer/import/helper/order.h"
#include "renderer/import/helper/source.h"

/* Number of first bytes that a probe gets, unpacked if the file is gzip or bzip2. */
#define TC_PROBE_BYTES 4096

typedef struct tc_format {
  const char *name;
  const char *suffixes; /* "|"-separated, lower case; used only if the content does not decide */
  bool (*probe)(const uint8_t *head, size_t size);
  bool (*read)(const tc_input *input, const tc_order *order, GError **error); /* the caller keeps the input */
} tc_format;

/* Reads a file of any of the formats; the caller keeps the input. A data file with its header next to it is read
 * through that header. `choice` is the text after the '#' of the path, or "". */
bool tc_formats_read(tc_input *input, const char *choice, const tc_order *order, GError **error);

/* Whether the content is a volume of one of the formats: a header or a complete file, but not a bare data file. */
bool tc_formats_know(const tc_input *input);

extern const tc_format tc_format_nifti, tc_format_nrrd, tc_format_metaimage, tc_format_mgh, tc_format_parrec, tc_format_minc, tc_format_vmd;
extern const tc_format tc_format_ply, tc_format_stl, tc_format_obj; /* mesh formats */

/* Whether a file of `whole` bytes with these first bytes is a binary STL: its number of triangles determines its
 * length. */
bool tc_stl_fits(const uint8_t *head, size_t size, uint64_t whole);

#endif
