/* What the DICOM helper says to its parent: a one-way stream of framed messages over a pipe.
 *
 *   message  u32 kind, u32 length, then `length` bytes; all numbers little-endian
 *   list:    PROGRESS* SERIES* END            or FAIL at any place
 *   load:    PROGRESS* HEAD (VOXELS|PROGRESS)* END   or FAIL at any place
 *
 * Why a pipe and not a shared memory file: the parent reads the voxels straight into the volume's own storage, so they
 * are in its memory once (a mapped file would count against it a second time until copied), nothing the helper keeps
 * can change them afterwards, and a helper that dies half-way is an ordinary end of file. The writer's side trusts the
 * helper; the reader's side trusts nothing: every length has a cap by kind, every number a range, text becomes
 * printable ASCII, and voxels are counted against the volume that was announced. */
#ifndef TC_IMPORT_DICOM_WIRE_H
#define TC_IMPORT_DICOM_WIRE_H

#include "renderer/import/import.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
  TC_DICOM_SERIES_MAX = 4096,         /* series in one listing */
  TC_DICOM_CHUNK_BYTES = 1024 * 1024, /* longest VOXELS message */
};

/* Message kinds and the sizes of their bodies. */
enum { TC_DICOM_PROGRESS = 0x50434431, TC_DICOM_SERIES, TC_DICOM_HEAD, TC_DICOM_VOXELS, TC_DICOM_FAIL, TC_DICOM_END };
enum {
  TC_DICOM_HEADER_BYTES = 8,
  TC_DICOM_FAIL_TEXT = 320,
  TC_DICOM_SERIES_BYTES = 72 + 16 + 64 + 48 + 7 * 4,
  /* dims, type, frames, volume, slices used and found, bridged, resampled; spacing, origin, direction, slope, intercept, window; modality, unit, note */
  TC_DICOM_HEAD_BYTES = 10 * 4 + (3 + 3 + 9 + 2 + 2) * 8 + 16 + 16 + 256,
  TC_DICOM_HEAD_NUMBERS = 3 + 3 + 9 + 2 + 2,
};

/* Moves exactly `size` bytes or fails with *error set. */
typedef bool (*tc_dicom_read_fn)(void *user, void *bytes, size_t size, GError **error);

/* Reads a load. `tick` is called with 0..1 at PROGRESS; false cancels. `max_voxel_bytes` 0 = no
 * limit. NULL with an error when the stream is not what it must be, or carries the helper's own FAIL. */
typedef struct tc_dicom_wire_reader {
  tc_dicom_read_fn read;
  void *user;
  tc_progress_fn tick; /* NULL: none */
  void *tick_user;
  uint64_t max_voxel_bytes;
  tc_reserve_fn reserve; /* NULL: none; with tick_user */
} tc_dicom_wire_reader;

tc_volume *tc_dicom_wire_load(const tc_dicom_wire_reader *reader, GError **error);
bool tc_dicom_wire_list(const tc_dicom_wire_reader *reader, tc_series **series, size_t *count, GError **error);

/* The helper's side, on a blocking descriptor. False when the parent is gone: end quietly. */
bool tc_dicom_wire_send_progress(int fd, double fraction);
bool tc_dicom_wire_send_series(int fd, const tc_series *series);
bool tc_dicom_wire_send_head(int fd, const tc_volume_desc *desc, const tc_provenance *from);
bool tc_dicom_wire_send_voxels(int fd, const void *bytes, size_t size); /* any size; cut into chunks */
bool tc_dicom_wire_send_fail(int fd, int code, const char *text);
bool tc_dicom_wire_send_end(int fd);

#ifdef __cplusplus
}
#endif
#endif
