/* Shared by the two files of NRRD: nrrd.c parses the header and finds the data, nrrd_axes.c derives the axes. */
#ifndef TC_IMPORT_NRRD_H
#define TC_IMPORT_NRRD_H

#include "renderer/import/helper/convert.h"

enum { tc_nrrd_max_dims = 16 };

typedef enum tc_nrrd_field {
  NRRD_TYPE, NRRD_DIMENSION, NRRD_SIZES, NRRD_ENCODING, NRRD_ENDIAN, NRRD_SPACE, NRRD_SPACE_DIMENSION,
  NRRD_SPACE_DIRECTIONS, NRRD_SPACE_ORIGIN, NRRD_SPACE_UNITS, NRRD_SPACINGS, NRRD_AXIS_MINS, NRRD_AXIS_MAXS,
  NRRD_CENTERINGS, NRRD_KINDS, NRRD_UNITS, NRRD_LINE_SKIP, NRRD_BYTE_SKIP, NRRD_DATA_FILE, NRRD_SAMPLE_UNITS,
  NRRD_FIELD_COUNT
} tc_nrrd_field;

typedef struct tc_nrrd_header {
  char *fields[NRRD_FIELD_COUNT]; /* the text of each field given, or NULL; owned */
  int lines[NRRD_FIELD_COUNT];    /* line number of each field, from 1 */
  char modality[16];              /* from a key/value pair, or "" */
  GArray *segments;               /* tc_layered, from 3D Slicer's key/value pairs, or NULL; owned */
  GPtrArray *names;               /* data files, or NULL: attached; owned */
  uint64_t data_at;               /* first byte after the header */
  int dimension;
  uint64_t sizes[tc_nrrd_max_dims]; /* [dimension], fastest first */
} tc_nrrd_header;


/* Sets the error "header line N: FIELD: ..." for a field of the header, "FIELD: ..." for a missing one. */
void tc_nrrd_error(const tc_nrrd_header *header, tc_nrrd_field field, tc_error_code code, GError **error,
                   const char *format, ...) G_GNUC_PRINTF(5, 6);

/* Fills dims, components, frames and the geometry of the raster. raster->element must be set. */
bool tc_nrrd_set_axes(tc_raster *raster, const tc_nrrd_header *header, GError **error);

#endif
