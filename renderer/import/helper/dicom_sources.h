/* The bytes of DICOM objects from a file, a folder of files, or a zip. */
#ifndef TC_IMPORT_DICOM_SOURCES_H
#define TC_IMPORT_DICOM_SOURCES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/import/helper.h"
#include "renderer/import/helper/dicom_zip.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The files under the input, numbered from 0: one file, the files of a folder (recursive, sorted by name; links to
 * folders are not followed), or the members of a zip. */
typedef struct tc_dicom_sources {
  int root;
  GPtrArray *names; /* of a folder; NULL otherwise */
  tc_dicom_zip zip; /* of a zip */
  bool is_zip;
  void *map; /* the zip or the one file, [map_size] */
  size_t map_size;
  bool unpacked; /* the input was gzip or bzip2: map is heap memory */
  size_t count;
} tc_dicom_sources;

/* `root` is an open folder or file and stays the caller's. TC_ERROR_IO, _FORMAT, _LIMIT. */
bool tc_dicom_sources_open(tc_dicom_sources *sources, int root, GError **error);
void tc_dicom_sources_finish(tc_dicom_sources *sources);

/* The bytes of one source: mapped, or inflated into memory. */
typedef struct tc_dicom_blob {
  const uint8_t *bytes; /* [size] */
  size_t size;
  void *map, *heap; /* memory to release */
} tc_dicom_blob;

/* Kind of a source by its first bytes. */
typedef enum tc_dicom_source_kind { TC_SOURCE_OTHER, TC_SOURCE_DICOM, TC_SOURCE_PICTURE, TC_SOURCE_HDF5 } tc_dicom_source_kind;
tc_dicom_source_kind tc_dicom_sources_kind(const tc_dicom_sources *sources, size_t index);
const char *tc_dicom_sources_name(const tc_dicom_sources *sources, size_t index); /* sort key; "" for a single file */

/* Returns false without an error if the source does not look like `kind`, and with one if it cannot be read. */
bool tc_dicom_sources_get_kind(const tc_dicom_sources *sources, size_t index, tc_dicom_source_kind kind,
                               tc_dicom_blob *blob, GError **error);
/* tc_dicom_sources_get_kind() for TC_SOURCE_DICOM. */
bool tc_dicom_sources_get(const tc_dicom_sources *sources, size_t index, tc_dicom_blob *blob, GError **error);
void tc_dicom_blob_finish(tc_dicom_blob *blob); /* accepts a zeroed blob */

#ifdef __cplusplus
}
#endif
#endif
