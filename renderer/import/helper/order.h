/* What is wanted of a file, and where its voxels or its mesh go: to the daemon (output.h), or in tests to this process. */
#ifndef TC_IMPORT_ORDER_H
#define TC_IMPORT_ORDER_H

#include "renderer/import/wire.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { TC_ORDER_MOST_BYTES = TC_WIRE_SLOT_BYTES }; /* of voxels at a time */

/* Every function returns false (NULL) with an error to end the work. */
typedef struct tc_order {
  uint32_t volume;          /* of a file of several, from 1; 0: the first */
  bool mesh;                /* a mesh is wanted, not a volume */
  uint64_t max_voxel_bytes; /* of a mesh: of its vertices, normals and triangles; 0: no limit */
  void *user;               /* of all that follow */
  bool (*want)(void *user, uint64_t bytes, GError **error); /* memory, before anything is decoded */
  bool (*begin)(void *user, const tc_volume_desc *desc, const tc_provenance *from, GError **error);
  bool (*begin_mesh)(void *user, const tc_mesh_head *head, GError **error); /* positions, normals, triangles follow */
  /* Instead of begin: a run-length model, whose bytes (of a .vmd that is not deflated) are the voxels. */
  bool (*begin_model)(void *user, uint64_t bytes, GError **error);
  bool (*segment)(void *user, const tc_segment *segment, GError **error); /* after begin: what a label is */
  void *(*room)(void *user, GError **error); /* where the next bytes go: TC_ORDER_MOST_BYTES; the same until filled */
  bool (*filled)(void *user, size_t bytes, GError **error);
  bool (*goes_on)(void *user, double fraction, GError **error); /* 0..1 */
  int (*open)(void *user, const char *name, bool optional, GError **error); /* a file beside the input, as in wire.h */
} tc_order;

/* Copies voxels of any number of bytes. */
bool tc_order_put(const tc_order *order, const void *voxels, size_t bytes, GError **error);

/* What "#volume=N" after the path of a file of `format` says; *volume stays where nothing is said. */
bool tc_choice_volume(const char *choice, const char *format, uint32_t *volume, GError **error);

/* Ends the work: another helper reads this. Returns false. */
bool tc_order_elsewhere(tc_helper helper, GError **error);

/* Decodes the file or folder `input` (which stays the caller's) into the order. Of the helper programs one has the
 * one that knows DICOM (dicom.cc), one that of MINC (minc_only.c), and one that of all other formats (formats_only.c). */
bool tc_helper_decode(int input, const tc_helper_request *request, const tc_order *order, GError **error);

#ifdef __cplusplus
}
#endif
#endif
