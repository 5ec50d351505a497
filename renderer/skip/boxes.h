/* What shows something, as a list of boxes: the form in which empty space is left out by projecting what is not empty
 * (skip/cover.h) instead of asking on every ray (skip/skip.h). Depends on the volume and on what shows, not on the
 * camera.
 *
 * The blocks that are not empty are cut into boxes two cells wide, each tested by its own voxels: a vessel two voxels
 * thick then has around it a third of the space that whole blocks have. Where nothing is empty boxes are as large as
 * can be. Every cell outside all boxes is empty in the sense of skip/skip.h. */
#ifndef TC_SKIP_BOXES_H
#define TC_SKIP_BOXES_H

#include "renderer/skip/skip.h"

#define TC_BOX_REACH 65536 /* voxels that an axis may have */
#define TC_BOX_FINE 2  /* cells a fine box is wide */
#define TC_BOX_FINES 3 /* fine boxes along a cut one */

/* Cells [at, at + size) along each axis; or of them the fine boxes whose bits are set: bit (z * 3 + y) * 3 + x for the
 * one that begins 2x, 2y, 2z cells further. One record instead of up to 27 keeps the list under two hundredths of the
 * voxels. */
typedef struct tc_box {
  uint16_t at[3], size;
  uint32_t fine; /* 0: the whole box */
} tc_box;

typedef struct tc_boxes {
  tc_box *items;
  size_t count;       /* of items */
  int block;          /* voxels: of the blocks that were cut */
  double empty_share; /* of these */
  double zero_below, zero_above; /* tc_support_zones() */
  uint64_t support;   /* serial of what it was built with */
  size_t bytes;
  double build_ms;
  struct tc_boxing *begun; /* NULL once they are made */
} tc_boxes;

/* Whether boxes can name every cell of the volume: no axis is longer than TC_BOX_REACH. */
bool tc_boxes_serve(const tc_volume *volume);

/* Of the volume that is sampled, and `minmax` of the same: the filter reaches as far as it says. NULL with
 * TC_ERROR_MEMORY. pool: of the calls that follow. */
tc_boxes *tc_boxes_begin(const tc_volume *volume, const tc_minmax *minmax, const tc_support *support, tc_pool *pool,
                         GError **error);
/* Goes on until they are made: true, at once for those that are. False: the pool's halt, to be called again; or
 * TC_ERROR_MEMORY. */
bool tc_boxes_go_on(tc_boxes *boxes, const tc_volume *volume, const tc_minmax *minmax, tc_pool *pool, GError **error);
int tc_boxes_steps(const tc_boxes *boxes); /* done so far: it grows */
void tc_boxes_free(tc_boxes *boxes); /* NULL is fine */

#endif
