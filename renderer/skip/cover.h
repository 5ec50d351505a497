/* What of a picture's rays may show something: the boxes that are not empty (skip/boxes.h), projected.
 *
 * The picture is cut into square cells of pixels, and depth into slots; one bit a cell and slot says whether a box is
 * there. A ray's march is then a walk over runs of set bits: nothing is asked in the empty stretches, and all rays of a
 * packet, and all rays of a pixel, share the answer. In the manner of SparseLeap (Hadwiger et al., IEEE TVCG 24(1),
 * 2018), which rasterises occupied space into lists of segments; here the lists are bits, so that boxes may come in any
 * order and from any thread. Conservative: a box's bits cover every ray through every pixel's area.
 *
 * Depth is mm along the view from the anchor's plane (raycast/rays.h): of a ray's point at s it is s * view_depth /
 * |view| (perspective) or s (orthographic). */
#ifndef TC_SKIP_COVER_H
#define TC_SKIP_COVER_H

#include "renderer/raycast/rays.h"
#include "renderer/skip/boxes.h"

typedef struct tc_cover {
  uint64_t *bits;      /* [cells y][words][cells x]; bit b of word w of a cell: slot 64 w + b is not empty */
  int shift;           /* a cell is 1 << shift pixels wide and high */
  int cells[2], words; /* words: of 64 slots */
  double near_mm, slot_mm; /* depth where slot 0 begins; of a slot */
  double view_depth;   /* mm from the eye to the anchor's plane; perspective only */
  size_t capacity;     /* of bits, in words; workers fill planes of their own that are joined into the first */
} tc_cover;

/* Fills *cover, whose bits are kept from frame to frame and grow as needed; zeroed before its first use. False with
 * TC_ERROR_MEMORY, TC_ERROR_INVALID for a camera whose rays are all one, or what the pool's halt says. */
bool tc_cover_fill(tc_cover *cover, const tc_boxes *boxes, const tc_volume *volume, const tc_rays *rays, int width,
                   int height, tc_pool *pool, GError **error);
void tc_cover_finish(tc_cover *cover);

#endif
