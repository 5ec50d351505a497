/* The pieces of the helper program: where its bytes come from and how it locks itself in. */
#ifndef TC_IMPORT_DICOM_HELPER_H
#define TC_IMPORT_DICOM_HELPER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/import/dicom_zip.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The descriptors the parent hands over, and the arguments: MODE SERIES MAX_VOXEL_BYTES ADDRESS_BYTES CPU_SECONDS
 * LANDLOCK, where MODE is "load" or "list", SERIES may be empty, and LANDLOCK "no" allows to do without. */
enum { TC_DICOM_INPUT_FD = 3, TC_DICOM_OUTPUT_FD = 4 };

/* True when the first bytes of a file could be DICOM: the mark at 128, or a bare data set that begins plausibly. 132
 * bytes are enough to decide. */
enum { TC_DICOM_HEAD_BYTES_NEEDED = 132 };
bool tc_dicom_looks(const uint8_t *head, size_t size);

/* The files under the input, numbered from 0: one file, a folder's (recursive, by name, links to folders not followed), or a
 * zip's. */
typedef struct tc_dicom_sources {
  int root;
  GPtrArray *names; /* of a folder; NULL otherwise */
  tc_dicom_zip zip; /* of a zip */
  bool is_zip;
  void *map; /* the zip or the one file, [map_size] */
  size_t map_size;
  size_t count;
} tc_dicom_sources;

/* `root` is an open folder or file and stays the caller's. TC_ERROR_IO, _FORMAT, _LIMIT. */
bool tc_dicom_sources_open(tc_dicom_sources *sources, int root, GError **error);
void tc_dicom_sources_finish(tc_dicom_sources *sources);

/* The bytes of one source: mapped, or inflated into memory. */
typedef struct tc_dicom_blob {
  const uint8_t *bytes; /* [size] */
  size_t size;
  void *map, *heap; /* what to give back */
} tc_dicom_blob;

/* False without an error for what does not look like DICOM; with one for what cannot be read. */
bool tc_dicom_sources_get(const tc_dicom_sources *sources, size_t index, tc_dicom_blob *blob, GError **error);
void tc_dicom_blob_finish(tc_dicom_blob *blob); /* a zeroed one is fine */

/* Gives up everything a decoder does not need, for good: limits, capabilities, new privileges, files other than
 * `input_fd`, what is beneath it and what the links of an annex above it lead to (Landlock), and system calls (seccomp: an
 * allow-list without sockets, programs, processes, signals to others, or writing to files). TC_ERROR_IO when the system
 * has no seccomp, or no Landlock unless `without_landlock`: then nothing may be decoded. */
bool tc_dicom_confine(int input_fd, uint64_t address_bytes, uint64_t cpu_seconds, bool without_landlock,
                      GError **error);

#ifdef __cplusplus
}
#endif
#endif
