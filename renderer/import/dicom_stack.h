/* From loose DICOM pictures with positions to one regular stack: which pictures, in which order, on which grid.
 *
 * Pure geometry, no DICOM: the helper reads headers into tc_dicom_slice records, this decides. Rules:
 * - The largest set of pictures of one size and one orientation is the stack; others are left out and counted in the
 * note.
 * - Order is the position along row x column, never file names. Pictures at one position are time points, echoes or the
 *   like: the first of each (by instance, then frame) is taken; frames tells how many there were.
 * - Spacing is measured from positions. Steps may differ by 10 %; a step of more than 1.5 times the usual one
 *   is a missing slice and an error: a picture with a wrong geometry is worse than none.
 * - Column 2 of direction points from first to last position, so a gantry tilt shears the grid and nothing is
 * resampled.
 * - Segmentation frames (sparse) may share a position and may skip some: layers without a frame stay empty.
 * - Without positions the order is instance, then frame; spacing is the header's, else 1 mm, said in the note. */
#ifndef TC_IMPORT_DICOM_STACK_H
#define TC_IMPORT_DICOM_STACK_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/error.h"

#ifdef __cplusplus
extern "C" {
#endif

/* One 2-D picture: where it is and how it lies. Lengths in mm, LPS. */
typedef struct tc_dicom_slice {
  uint32_t source, frame; /* file, and frame in it from 0 */
  int32_t instance;       /* acquisition order across files */
  uint32_t group;         /* acquisition, stack, echo ... mixed into one key; splits a series that makes no one stack */
  uint32_t segment;       /* segmentation: number from 1; else 0 */
  bool sparse;            /* a segmentation: frames may share positions and may be missing */
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

typedef struct tc_dicom_stack {
  tc_dicom_layer_item *items; /* [count], owned */
  size_t count;
  int dims[3];
  double spacing[3], origin[3], direction[9];
  int frames;
  char note[256];
} tc_dicom_stack;

/* Decides. slices [count], count >= 1. TC_ERROR_FORMAT when they make no regular stack. */
bool tc_dicom_stack_make(const tc_dicom_slice *slices, size_t count, tc_dicom_stack *stack, GError **error);
void tc_dicom_stack_finish(tc_dicom_stack *stack); /* frees; a zeroed one is fine */

/* Adds one clause to a note ("a; b"), cut at its end. */
void tc_dicom_note(char note[256], const char *format, ...) G_GNUC_PRINTF(2, 3);

#ifdef __cplusplus
}
#endif
#endif
