/* From the pictures of one volume to one regular stack: in which order, on which grid.
 *
 * Pure geometry, no DICOM: the helper reads headers into tc_dicom_slice records, dicom_group.h says which of them belong
 * together, this places them. Rules:
 * - Order is the position along row x column, never file names.
 * - Spacing is measured from positions. Where no slice is further than a tenth of a step from its place on a regular
 *   grid, that grid is used. Else layers are mixed from the two slices around them, linearly along the stack, on a
 *   grid from the first to the last slice as fine as the least step (at most 8 layers a slice).
 * - One slice that is missing within equal steps is bridged in the same way, and named; several are an error: a picture
 *   with a wrong geometry is worse than none.
 * - Column 2 of direction points from first to last position, so a gantry tilt shears the grid and pixels stay as they
 *   are.
 * - Segmentation frames (sparse) may share a position and may skip some: layers without a frame stay empty.
 * - Without positions the order is instance, then frame; spacing is the header's, else 1 mm, said in the note. */
#ifndef TC_IMPORT_DICOM_STACK_H
#define TC_IMPORT_DICOM_STACK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"

#ifdef __cplusplus
extern "C" {
#endif

/* What tells the volumes of a series apart, strongest first; 0 where the header says nothing. */
typedef enum tc_dicom_key {
  TC_DICOM_KEY_STACK, /* the rank of its name */
  TC_DICOM_KEY_TIME,  /* temporal position */
  TC_DICOM_KEY_ECHO,  /* number */
  TC_DICOM_KEY_ECHO_TIME,
  TC_DICOM_KEY_B_VALUE,
  TC_DICOM_KEY_PHASE,      /* of the heart, percent */
  TC_DICOM_KEY_IMAGE_TYPE, /* rank */
  TC_DICOM_KEY_ACQUISITION,
  TC_DICOM_KEY_COUNT
} tc_dicom_key;

/* One 2-D picture: where it is and how it lies. Lengths in mm, LPS. */
typedef struct tc_dicom_slice {
  uint32_t source, frame; /* file, and frame in it from 0 */
  int32_t instance;       /* acquisition order across files */
  uint64_t uid;           /* a checksum of the picture's UID, 0 none: copies have the same */
  double keys[TC_DICOM_KEY_COUNT];
  double trigger;         /* ms after the heart's beat: orders what shares a position */
  uint32_t segment;       /* segmentation: number from 1; else 0 */
  bool sparse;            /* a segmentation: frames may share positions and may be missing */
  bool fractional;        /* one whose samples are fractions */
  int rows, columns;
  bool has_position, has_orientation, has_spacing;
  double position[3];    /* centre of the first voxel */
  double orientation[6]; /* unit vectors along a row, along a column */
  double spacing[2];     /* between columns (x), between rows (y) */
  double between;        /* header's distance between slices, 0 unknown */
  double thickness;      /* 0 unknown */
} tc_dicom_slice;

typedef struct tc_dicom_layer_item {
  uint32_t slice; /* index into the slices given */
  uint32_t layer; /* 0 .. dims[2]-1, ascending; several per layer only for segmentations */
} tc_dicom_layer_item;

/* A layer between two slices: (1 - part) of `item` and part of the one after it. */
typedef struct tc_dicom_mix {
  uint32_t item;
  float part;
} tc_dicom_mix;

typedef struct tc_dicom_stack {
  tc_dicom_layer_item *items; /* [count], owned */
  size_t count;
  tc_dicom_mix *mix; /* [dims[2]], owned: how layers come from items; NULL: items say their layers themselves */
  int dims[3];
  int bridged; /* the layer that stands for a missing slice, from 1; 0 none */
  double spacing[3], origin[3], direction[9];
  char note[256];
} tc_dicom_stack;

/* The unit vector across a picture: row x column, z where it has no orientation. */
void tc_dicom_normal(const tc_dicom_slice *slice, double normal[3]);

/* How far apart two of `count` positions over `range` mm may be and still be one: a fifth of the average step, 0.05 mm at
 * most. */
double tc_dicom_same_place(double range, size_t count);

/* Places the pictures `chosen` [count] of `slices`, count >= 1, all of one size and orientation and, but for
 * segmentations, one at a position. TC_ERROR_FORMAT when they make no stack. */
bool tc_dicom_stack_make(const tc_dicom_slice *slices, const uint32_t *chosen, size_t count, tc_dicom_stack *stack,
                         GError **error);
void tc_dicom_stack_finish(tc_dicom_stack *stack); /* frees; a zeroed one is fine */

/* Adds one clause to a note ("a; b"), cut at its end. */
void tc_dicom_note(char note[256], const char *format, ...) G_GNUC_PRINTF(2, 3);

#ifdef __cplusplus
}
#endif
#endif
