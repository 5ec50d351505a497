/* A request to decode a file, and the destination of its voxels or mesh: the daemon (output.h), or in tests this
 * process. */
#ifndef TC_IMPORT_ORDER_H
#define TC_IMPORT_ORDER_H

#include "renderer/import/wire.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { TC_ORDER_MOST_BYTES = TC_WIRE_SLOT_BYTES }; /* largest number of voxel bytes at a time */

/* Every function returns false (NULL) with an error to end the decoding. */
typedef struct tc_order {
  uint32_t volume;          /* number of the volume in a file of several, from 1; 0: the first */
  bool mesh;                /* a mesh is expected, not a volume */
  uint64_t max_voxel_bytes; /* limit; for a mesh, on vertices, normals and triangles together; 0: none */
  void *user;               /* passed to all callbacks */
  bool (*want)(void *user, uint64_t bytes, GError **error); /* announces memory before anything is decoded */
  bool (*begin)(void *user, const tc_volume_desc *desc, const tc_provenance *from, GError **error);
  bool (*begin_mesh)(void *user, const tc_mesh_head *head, GError **error); /* followed by positions, normals, triangles */
  /* Called instead of begin for a run-length model; the bytes of an uncompressed .vmd follow as voxels. */
  bool (*begin_model)(void *user, uint64_t bytes, GError **error);
  bool (*segment)(void *user, const tc_segment *segment, GError **error); /* after begin: describes a label */
  void *(*room)(void *user, GError **error); /* buffer for the next TC_ORDER_MOST_BYTES; the same buffer until it is full */
  bool (*filled)(void *user, size_t bytes, GError **error);
  bool (*goes_on)(void *user, double fraction, GError **error); /* progress 0..1 */
  int (*open)(void *user, const char *name, bool optional, GError **error); /* opens a file next to the input, as in wire.h */
} tc_order;

/* Sends any number of voxel bytes. */
bool tc_order_put(const tc_order *order, const void *voxels, size_t bytes, GError **error);

/* Parses "#volume=N" after the path of a file of `format`; *volume keeps its value without such a suffix. */
bool tc_choice_volume(const char *choice, const char *format, uint32_t *volume, GError **error);

/* Ends the decoding because another helper must read this file. Returns false. */
bool tc_order_elsewhere(tc_helper helper, GError **error);

/* Decodes the file or folder `input` (the caller keeps it) into the order. Each helper program links one version:
 * with DICOM (dicom.cc), with MINC (minc_only.c), or with all other formats (formats_only.c). */
bool tc_helper_decode(int input, const tc_helper_request *request, const tc_order *order, GError **error);

#ifdef __cplusplus
}
#endif
#endif
