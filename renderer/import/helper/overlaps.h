/* Exact overlaps of segments: each combination of segments that share a voxel gets its own label. */
#ifndef TC_IMPORT_OVERLAPS_H
#define TC_IMPORT_OVERLAPS_H

#include "renderer/import/helper/order.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct tc_overlaps {
  uint32_t last;     /* largest label of a single segment */
  GArray *made;      /* tc_segment: the combinations, labels from last + 1 */
  GHashTable *pairs; /* key: a label and a segment added to it; value: the combination's label */
  uint32_t under, segment, label; /* the previous look-up */
  bool full;         /* there are more combinations than labels; the later segment wins from here on */
} tc_overlaps;

void tc_overlaps_init(tc_overlaps *overlaps, uint32_t last);
void tc_overlaps_finish(tc_overlaps *overlaps); /* accepts a zeroed value */

/* The label of a voxel that has label `under` (0: none) and also belongs to `segment`, 1..last. */
uint32_t tc_overlaps_label(tc_overlaps *overlaps, uint32_t under, uint32_t segment);

/* The largest label in use. */
uint32_t tc_overlaps_most(const tc_overlaps *overlaps);

/* Sends names and colours of the labels: `segments` [count], and their combinations. */
bool tc_overlaps_send(const tc_overlaps *overlaps, const tc_segment *segments, size_t count, const tc_order *order,
                      GError **error);

#ifdef __cplusplus
}
#endif
#endif
