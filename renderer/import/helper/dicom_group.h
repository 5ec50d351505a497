/* Which pictures of a series belong together: a series becomes volumes, and no volume is a mixture.
 *
 * Pure geometry and header numbers, no DICOM. Rules:
 * - Pictures of different size, pixel spacing or orientation (over 0.8 degrees) are different volumes.
 * - So are those of another stack, time, echo, b-value or cardiac phase (the first keys).
 * - Image type and acquisition number (the last keys) part pictures only where the parts lie among each other: a scan
 *   may be acquired piece by piece, one piece beyond the other, and is one volume then. Acquisitions that share
 *   positions, or lie between each other's slices, are volumes of their own.
 * - What is still at one position is told apart by its turn (trigger time, instance, frame), where every position has
 *   as many pictures or the instances run through the stack again and again; else the volume is tangled.
 * - Copies of one picture (the same UID and frame) are one.
 * - Frames of segmentations share positions by design: one volume, of labels. Where they hold fractions, each segment
 *   makes another, of its own. */
#ifndef TC_IMPORT_DICOM_GROUP_H
#define TC_IMPORT_DICOM_GROUP_H

#include "renderer/import/helper/dicom_stack.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tc_dicom_group {
  uint32_t *slices; /* [count], indices of the slices given */
  size_t count;
  size_t places;  /* different positions among them */
  uint32_t segment; /* whose fractions these are; 0: none's */
  bool tangled;   /* pictures share positions and nothing tells them apart: no volume can be made */
  char what[48];  /* what tells it from the others: "echo 90 ms", "time 2", "" */
} tc_dicom_group;

typedef struct tc_dicom_groups {
  tc_dicom_group *list; /* [count], owned: by orientation, then by key and turn */
  size_t count;
  size_t places; /* different positions of all pictures: what a volume's share is measured against */
  size_t copies; /* pictures that were there more than once */
  uint32_t *store;
} tc_dicom_groups;

/* slices [count], count >= 1. Never fails. */
void tc_dicom_groups_make(const tc_dicom_slice *slices, size_t count, tc_dicom_groups *groups);
void tc_dicom_groups_finish(tc_dicom_groups *groups); /* frees; a zeroed one is fine */

/* The volume to open: number `wanted` (from 1), or for 0 the one with most positions, the first of equals. That one
 * must hold at least half of all positions, else TC_ERROR_FORMAT: a piece is opened only for who asks for it.
 * TC_ERROR_NOT_FOUND for a number that is not there. -1 with an error. */
int tc_dicom_groups_choose(const tc_dicom_groups *groups, unsigned wanted, GError **error);

#ifdef __cplusplus
}
#endif
#endif
