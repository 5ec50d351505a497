/* Occupied space as a list of boxes. Empty-space skipping in dvr on the CPU projects the boxes onto the picture
 * (skip/cover.h) instead of looking up a distance map along every ray (skip/skip.h). The list depends on the volume and
 * the support, not on the camera.
 *
 * Each fine box (skip/fine.h), two cells wide, is tested by its own minimum and maximum: around a vessel two voxels
 * thick they occupy a third of the space of blocks. Where nothing is empty, fine boxes are merged.
 *
 * Every cell outside all boxes is empty in the sense of skip/skip.h. */
#ifndef TC_SKIP_BOXES_H
#define TC_SKIP_BOXES_H

#include "renderer/skip/fine.h"

#define TC_BOX_REACH 65536 /* largest number of voxels along an axis */
#define TC_BOX_FINES 3 /* fine boxes along each axis of a record */

/* A record: cells [at, at + size) along each axis, or only the fine boxes whose bit is set: bit (z * 3 + y) * 3 + x
 * stands for the fine box at offset x, y, z, in fine boxes. One record for up to 27 fine boxes keeps the list below 2 %
 * of the voxel bytes. */
typedef struct tc_box {
  uint16_t at[3], size;
  uint32_t fine; /* 0: the whole box */
} tc_box;

typedef struct tc_boxes {
  tc_box *items;
  size_t count;       /* of items */
  int block;          /* width of a fine box, cells */
  double empty_share; /* share of the records that are empty */
  uint64_t support;   /* serial of the support */
  size_t bytes;
  double build_ms;
  struct tc_boxing *begun; /* work in progress; NULL once complete */
} tc_boxes;

/* True if boxes can address every cell of the volume: no axis is longer than TC_BOX_REACH. */
bool tc_boxes_serve(const tc_volume *volume);

/* Starts a build. fine: of the sampled volume. Pass the same `fine` and pool to the following calls. The caller frees.
 * NULL with TC_ERROR_MEMORY. */
tc_boxes *tc_boxes_begin(const tc_fine *fine, const tc_support *support, tc_pool *pool, GError **error);
/* Continues the build; true once the list is complete. False: the pool was halted (call again), or TC_ERROR_MEMORY. */
bool tc_boxes_go_on(tc_boxes *boxes, const tc_fine *fine, tc_pool *pool, GError **error);
int tc_boxes_steps(const tc_boxes *boxes); /* progress, increasing */
void tc_boxes_free(tc_boxes *boxes); /* NULL is fine */

#endif
