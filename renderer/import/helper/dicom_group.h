/* Divides the pictures of a series into volumes, so that no volume mixes pictures that do not belong together.
 *
 * Pure geometry and header numbers, no DICOM. Rules:
 * - Pictures of different size, pixel spacing or orientation (over 0.8 degrees) are in different volumes.
 * - So are pictures of different stack, time, echo, b-value or cardiac phase (the first keys).
 * - Image type and acquisition number (the last keys) separate pictures only if the parts interleave. A scan may be
 *   acquired piece by piece, each beyond the one before, and is one volume then. Acquisitions that share positions,
 *   or lie between each other's slices, are separate volumes.
 * - Pictures still at one position are separated by their turn (trigger time, instance, frame) if every position has
 *   equally many pictures or the instances run through the stack repeatedly; else the volume is tangled.
 * - Copies of one picture (same UID and frame) count once.
 * - Frames of segmentations share positions by design: they make one volume of labels. If they hold fractions, each
 *   segment makes a further volume. */
#ifndef TC_IMPORT_DICOM_GROUP_H
#define TC_IMPORT_DICOM_GROUP_H

#include "renderer/import/helper/dicom_stack.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tc_dicom_group {
  uint32_t *slices; /* [count], indices into the slices given */
  size_t count;
  size_t places;  /* number of different positions */
  uint32_t segment; /* segment whose fractions these slices hold; 0: none */
  bool tangled;   /* several pictures share a position and no header value distinguishes them: no volume can be made */
  char what[48];  /* difference from the other volumes: "echo 90 ms", "time 2", "" */
} tc_dicom_group;

typedef struct tc_dicom_groups {
  tc_dicom_group *list; /* [count], owned; sorted by orientation, then by key and turn */
  size_t count;
  size_t places; /* different positions of all pictures; a volume's share is measured against them */
  size_t copies; /* number of duplicate pictures */
  uint32_t *store;
} tc_dicom_groups;

/* slices [count], count >= 1. Never fails. */
void tc_dicom_groups_make(const tc_dicom_slice *slices, size_t count, tc_dicom_groups *groups);
void tc_dicom_groups_finish(tc_dicom_groups *groups); /* frees; a zeroed one is fine */

/* Chooses the volume to open: number `wanted` (from 1), or for 0 the one with most positions (the first of equals).
 * For 0 that volume must hold at least half of all positions, else TC_ERROR_FORMAT: a smaller part is opened only on
 * request. TC_ERROR_NOT_FOUND for an unknown number. Returns -1 with an error. */
int tc_dicom_groups_choose(const tc_dicom_groups *groups, unsigned wanted, GError **error);

#ifdef __cplusplus
}
#endif
#endif
