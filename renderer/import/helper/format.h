/* The formats, one file each: probe by the first bytes, read from an input. */
#ifndef TC_IMPORT_FORMAT_H
#define TC_IMPORT_FORMAT_H

#include "renderer/import/helper/order.h"
#include "renderer/import/helper/source.h"

/* How many first bytes (unpacked when the file is gzip or bzip2) the probes want to see. */
#define TC_PROBE_BYTES 4096

typedef struct tc_format {
  const char *name;
  const char *suffixes; /* "|"-separated, lower case; decides only where the content does not */
  bool (*probe)(const uint8_t *head, size_t size);
  bool (*read)(const tc_input *input, const tc_order *order, GError **error); /* the input stays the caller's */
} tc_format;

/* Reads a file of any of them, which stays the caller's; one that a header is found beside is read by that header.
 * `choice` is what followed the '#' of its path, or "". */
bool tc_formats_read(tc_input *input, const char *choice, const tc_order *order, GError **error);

/* Whether its content is a volume's of one of them: a header or a whole file, and no voxels beside one. */
bool tc_formats_know(const tc_input *input);

extern const tc_format tc_format_nifti, tc_format_nrrd, tc_format_metaimage, tc_format_mgh, tc_format_parrec, tc_format_minc, tc_format_vmd;
extern const tc_format tc_format_ply, tc_format_stl, tc_format_obj; /* of meshes */

/* Whether a file of `whole` bytes that begins so is a binary STL: its number of triangles says how long it must be. */
bool tc_stl_fits(const uint8_t *head, size_t size, uint64_t whole);

#endif
