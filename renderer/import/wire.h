/* Messages between the daemon and its helper over a socket pair; all numbers little-endian.
 *
 *   request  daemon to helper, first and once: tc_helper_request in its fixed form
 *   message  helper to daemon: u32 kind, u32 length, then `length` bytes
 *     list:    PROGRESS* SERIES* END                             or FAIL at any place
 *     load:    (PROGRESS|WANT|OPEN)* HEAD (VOXELS|SEGMENT|PROGRESS|OPEN)* END    or FAIL at any place. A run-length model
 *              sends MODEL instead of HEAD; VOXELS then carry the bytes of an uncompressed .vmd, which the daemon decodes
 *              like a file (splat/vmd.h)
 *     mesh:    as load, with MESH instead of HEAD; VOXELS carry positions, normals, colours and triangles as in tc_mesh
 *   reply    daemon to helper, one byte: after VOXELS, the slot is free again; after OPEN, the file's descriptor comes with
 *            the byte, or the file is missing
 *
 * Voxels travel through a small ring of slots in shared memory: the helper decodes into one slot while the daemon copies
 * the slot before it into the volume's own storage. The daemon holds the voxels once, in pages as large as any volume's,
 * and the helper cannot change them afterwards.
 *
 * The helper trusts the daemon; the daemon trusts nothing: every kind of message has a maximum length, every number a
 * range, text is reduced to printable ASCII, and voxels are counted against the announced volume. */
#ifndef TC_IMPORT_WIRE_H
#define TC_IMPORT_WIRE_H

#include "renderer/import/helper.h"

#ifdef __cplusplus
extern "C" {
#endif

/* The helper's descriptors. */
enum { TC_HELPER_INPUT_FD = 3, TC_HELPER_SOCKET_FD = 4, TC_HELPER_RING_FD = 5, TC_HELPER_LINKS_FD = 6 };

enum {
  TC_WIRE_SERIES_MAX = 4096, /* series in one listing */
  TC_WIRE_SLOT_BYTES = 512 * 1024,
  TC_WIRE_SLOTS = 4,
  TC_WIRE_RING_BYTES = TC_WIRE_SLOTS * TC_WIRE_SLOT_BYTES,
  TC_WIRE_NAME = 4096, /* longest name of a file beside, with its end */
};

/* Message kinds and the sizes of their bodies. */
enum {
  TC_WIRE_PROGRESS = 0x50434431, TC_WIRE_SERIES, TC_WIRE_HEAD, TC_WIRE_VOXELS, TC_WIRE_FAIL, TC_WIRE_END,
  TC_WIRE_WANT, /* memory: u64 bytes, before anything is decoded */
  TC_WIRE_OPEN, /* a file beside the input: u32 whether it may be missing, its name */
  TC_WIRE_MESH, /* of a mesh: tc_mesh_head, its numbers as f64 */
  TC_WIRE_MODEL, /* u64 bytes */
  TC_WIRE_SEGMENT, /* tc_segment; each label once */
};
enum {
  TC_WIRE_HEADER_BYTES = 8,
  TC_WIRE_FAIL_TEXT = 320,
  TC_WIRE_SERIES_BYTES = 72 + 16 + 64 + 48 + 64 + 32 + 128 + 7 * 4,
  /* dims, type, frames, volume, slices used and found, bridged, resampled, colors (VOXELS are then r, g, b each); spacing, origin, direction, slope, intercept,
     window; modality, unit, note, format, description, time */
  TC_WIRE_HEAD_BYTES = 11 * 4 + (3 + 3 + 9 + 2 + 2) * 8 + 16 + 16 + 256 + 16 + 64 + 16,
  TC_WIRE_SEGMENT_BYTES = 3 * 4 + 4 + 64, /* label, of; whether there is a colour, and its bytes; name */
  TC_WIRE_HEAD_NUMBERS = 3 + 3 + 9 + 2 + 2,
  TC_WIRE_MESH_BYTES = 6 * 8 + 2 * 4 + 16,
};

/* FAIL with this code plus a tc_helper: that helper has to read the file, as its unpacked content shows. */
enum { TC_WIRE_ELSEWHERE = 100 };

/* A mesh before its arrays. */
typedef struct tc_mesh_head {
  double origin[3];
  uint64_t n_vertices, n_triangles, degenerate; /* the last: left out */
  bool normals, colors;
  char format[16];
} tc_mesh_head;

/* Replies. */
enum { TC_WIRE_FREE = 'v', TC_WIRE_FILE = 'f', TC_WIRE_MISSING = 'm' };

/* The helper's task. Daemon and helper come from one build, so the struct is sent as it is. */
typedef struct tc_helper_request {
  bool list, mesh, without_landlock, self_contained, bridge_nothing, patient;
  uint32_t volume; /* as in tc_import_options */
  uint64_t max_voxel_bytes, address_bytes, cpu_seconds;
  uint32_t link_roots; /* number of link roots; their descriptors start at TC_HELPER_LINKS_FD */
  char name[256];   /* the input's base name */
  char choice[256]; /* text after the '#' of the path, or "" */
} tc_helper_request;

/* Moves exactly `size` bytes or fails with *error set. */
typedef bool (*tc_wire_read_fn)(void *user, void *bytes, size_t size, GError **error);

typedef struct tc_wire_reader {
  tc_wire_read_fn read;
  void *user;
  /* Sends a byte to the helper, with a descriptor (or -1), which the caller keeps. A failure shows at the next read. */
  void (*reply)(void *user, char what, int fd);
  /* Opens a data file next to the input. Returns -1 without an error if an optional file is missing, else -1 with an error. */
  int (*open)(void *user, const char *name, bool optional, GError **error);
  tc_progress_fn tick;   /* PROGRESS, 0..1; false cancels */
  tc_reserve_fn reserve; /* WANT and HEAD */
  const uint8_t *ring;   /* [TC_WIRE_RING_BYTES] */
  uint64_t max_voxel_bytes; /* 0 = no limit */
} tc_wire_reader;

/* Return NULL with an error if the stream breaks the protocol or carries the helper's FAIL. */
tc_volume *tc_wire_load(const tc_wire_reader *reader, GError **error);
tc_mesh *tc_wire_load_mesh(const tc_wire_reader *reader, tc_mesh_file *source, GError **error);
bool tc_wire_list(const tc_wire_reader *reader, tc_series **series, size_t *count, GError **error);

/* The helper's side, on a blocking descriptor. Return false if the daemon has gone; the helper then exits silently. */
bool tc_wire_send_progress(int fd, double fraction);
bool tc_wire_send_series(int fd, const tc_series *series);
bool tc_wire_send_want(int fd, uint64_t bytes);
bool tc_wire_send_open(int fd, const char *name, bool optional); /* a name shorter than TC_WIRE_NAME */
bool tc_wire_send_head(int fd, const tc_volume_desc *desc, const tc_provenance *from);
bool tc_wire_send_mesh(int fd, const tc_mesh_head *head);
bool tc_wire_send_model(int fd, uint64_t bytes);
bool tc_wire_send_segment(int fd, const tc_segment *segment);
bool tc_wire_send_voxels(int fd, unsigned slot, size_t bytes); /* of a slot, from its start */
bool tc_wire_send_fail(int fd, int code, const char *text);
bool tc_wire_send_end(int fd);

#ifdef __cplusplus
}
#endif
#endif
