/* Arranges the pictures of one volume as a regular stack: their order and their grid.
 *
 * Pure geometry, no DICOM: the helper reads headers into tc_dicom_slice records, dicom_group.h divides them into
 * volumes, and this file places them. Rules:
 * - Order is the position along row x column, never file names.
 * - Spacing is measured from positions. If no slice is farther than a tenth of a step from its place on a regular
 *   grid, that grid is used. Otherwise layers are interpolated linearly from the two nearest slices, on a grid from
 *   the first to the last slice as fine as the least step (at most 8 layers per slice).
 * - One missing slice within equal steps is bridged in the same way, and named. Several missing slices are an error:
 *   a picture with wrong geometry is worse than none.
 * - Column 2 of direction points from the first to the last position, so a gantry tilt shears the grid and pixels
 *   stay unchanged.
 * - Segmentation frames (sparse) may share positions and may skip some: layers without a frame stay empty.
 * - Without positions the order is instance, then frame; spacing is the header's, else 1 mm, and the note says so. */
#ifndef TC_IMPORT_DICOM_STACK_H
#define TC_IMPORT_DICOM_STACK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Values that distinguish the volumes of a series, strongest first; 0 if the header has none. */
typedef enum tc_dicom_key {
  TC_DICOM_KEY_STACK, /* rank of the stack's name */
  TC_DICOM_KEY_TIME,  /* temporal position */
  TC_DICOM_KEY_ECHO,  /* echo number */
  TC_DICOM_KEY_ECHO_TIME,
  TC_DICOM_KEY_B_VALUE,
  TC_DICOM_KEY_PHASE,      /* cardiac phase, percent */
  TC_DICOM_KEY_IMAGE_TYPE, /* rank */
  TC_DICOM_KEY_ACQUISITION,
  TC_DICOM_KEY_COUNT
} tc_dicom_key;

/* One 2-D picture and its place. Lengths in mm, LPS. */
typedef struct tc_dicom_slice {
  uint32_t source, frame; /* file, and frame within it from 0 */
  int32_t instance;       /* acquisition order across files */
  uint64_t uid;           /* hash of the picture's UID, 0 without one; copies have equal hashes */
  double keys[TC_DICOM_KEY_COUNT];
  double trigger;         /* ms after the heartbeat: orders pictures that share a position */
  uint32_t segment;       /* segmentation: number from 1; else 0 */
  bool sparse;            /* of a segmentation: frames may share positions and may be missing */
  bool fractional;        /* of a segmentation whose samples are fractions */
  int rows, columns;
  bool has_position, has_orientation, has_spacing;
  double position[3];    /* centre of the first voxel */
  double orientation[6]; /* unit vectors along a row, along a column */
  double spacing[2];     /* between columns (x), between rows (y) */
  double between;        /* distance between slices by the header, 0 unknown */
  double thickness;      /* 0 unknown */
} tc_dicom_slice;

typedef struct tc_dicom_layer_item {
  uint32_t slice; /* index into the slices given */
  uint32_t layer; /* 0 .. dims[2]-1, ascending; several per layer only for segmentations */
} tc_dicom_layer_item;

/* A layer interpolated between two slices: (1 - part) of `item` plus part of the next. */
typedef struct tc_dicom_mix {
  uint32_t item;
  float part;
} tc_dicom_mix;

typedef struct tc_dicom_stack {
  tc_dicom_layer_item *items; /* [count], owned */
  size_t count;
  tc_dicom_mix *mix; /* [dims[2]], owned: how each layer is interpolated; NULL: each item has its layer */
  int dims[3];
  int bridged; /* layer, from 1, that replaces a missing slice; 0 none */
  double spacing[3], origin[3], direction[9];
  char note[256];
} tc_dicom_stack;

/* Unit normal of a picture, row x column; z if the picture has no orientation. */
void tc_dicom_normal(const tc_dicom_slice *slice, double normal[3]);

/* Largest distance at which two of `count` positions over `range` mm count as one: a fifth of the average step, at
 * most 0.05 mm. */
double tc_dicom_same_place(double range, size_t count);

/* Arranges the pictures `chosen` [count] of `slices`, count >= 1. All have one size and orientation and, except in
 * segmentations, different positions. TC_ERROR_FORMAT if they make no stack. */
bool tc_dicom_stack_make(const tc_dicom_slice *slices, const uint32_t *chosen, size_t count, tc_dicom_stack *stack,
                         GError **error);
void tc_dicom_stack_finish(tc_dicom_stack *stack); /* frees; accepts a zeroed stack */

/* Appends a clause to a note ("a; b"), cut at the note's end. */
void tc_dicom_note(char note[256], const char *format, ...) G_GNUC_PRINTF(2, 3);

#ifdef __cplusplus
}
#endif
#endif
