/* Empty-space skipping in dvr on the CPU: occupied boxes (skip/boxes.h) rasterised into bits per cell of pixels and
 * slot of depth.
 *
 * A ray marches over runs of set bits; empty stretches cost nothing, and all rays of a packet or a pixel share the
 * runs. SparseLeap (Hadwiger et al., IEEE TVCG 24(1), 2018) rasterises occupied space into lists of segments; with
 * bits, boxes may come in any order and from any thread. Conservative: a box's bits cover every ray through the area of
 * every pixel.
 *
 * Depth is in mm along the view from the anchor plane (raycast/rays.h): for the point of a ray at s it is s *
 * view_depth / |view| (perspective) or s (orthographic). */
#ifndef TC_SKIP_COVER_H
#define TC_SKIP_COVER_H

#include "renderer/base/pool.h"
#include "renderer/raycast/rays.h"

/* From renderer/skip/boxes.h; a forward declaration, so that changes of that header do not recompile all kernels. */
typedef struct tc_boxes tc_boxes;

typedef struct tc_cover {
  uint64_t *bits;      /* [cells y][words][cells x]; bit b of word w of a cell: slot 64 w + b is occupied */
  int shift;           /* a cell is 1 << shift pixels wide and high */
  int cells[2], words; /* cells along x and y; words of 64 slots per cell */
  double near_mm, slot_mm; /* depth where slot 0 begins; depth of a slot */
  double view_depth;   /* mm from the eye to the anchor plane; perspective only */
  size_t capacity;     /* words allocated; each worker fills a separate plane, and the planes are merged into the
                          first */
} tc_cover;

/* Fills *cover. Zero it before the first use; its memory is reused from frame to frame. False with TC_ERROR_MEMORY,
 * TC_ERROR_INVALID for a camera whose rays coincide, or the halt's error. */
bool tc_cover_fill(tc_cover *cover, const tc_boxes *boxes, const tc_volume *volume, const tc_rays *rays,
                   tc_pool *pool, GError **error);
void tc_cover_finish(tc_cover *cover);

#endif
