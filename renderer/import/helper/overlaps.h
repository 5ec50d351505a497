/* Segments that overlap, kept exactly: where several share a voxel, their combination has a label of its own. */
#ifndef TC_IMPORT_OVERLAPS_H
#define TC_IMPORT_OVERLAPS_H

#include "renderer/import/helper/order.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tc_overlaps {
  uint32_t last;     /* the largest label of a single segment */
  GArray *made;      /* tc_segment: the combinations, labels last + 1 on */
  GHashTable *pairs; /* a label and a segment that joins it -> the combination's label */
  uint32_t under, segment, label; /* the answer before */
  bool full;         /* more combinations than labels: there, the later segment is kept */
} tc_overlaps;

void tc_overlaps_init(tc_overlaps *overlaps, uint32_t last);
void tc_overlaps_finish(tc_overlaps *overlaps); /* a zeroed one is fine */

/* The label of a voxel labelled `under` (0: nothing) that belongs to `segment`, 1..last, as well. */
uint32_t tc_overlaps_label(tc_overlaps *overlaps, uint32_t under, uint32_t segment);

/* The largest label there is. */
uint32_t tc_overlaps_most(const tc_overlaps *overlaps);

/* Tells the order what the labels are: `segments` [count] with their names and colours, and the combinations of them. */
bool tc_overlaps_send(const tc_overlaps *overlaps, const tc_segment *segments, size_t count, const tc_order *order,
                      GError **error);

#ifdef __cplusplus
}
#endif
#endif
