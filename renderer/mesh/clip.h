/* Triangles that the near plane, the guard planes or the scene's planes cut: what is left of them. */
#ifndef TC_MESH_CLIP_H
#define TC_MESH_CLIP_H

#include "renderer/mesh/view.h"

enum { TC_CLIP_MOST_CORNERS = 3 + TC_VIEW_PLANES };

typedef struct tc_clip_corner {
  double at[3];  /* relative to the mesh's origin */
  int original;  /* number of the triangle's own corner; -1: a plane made it */
} tc_clip_corner;

/* Cuts corners[3] at the planes whose bits are set (Sutherland and Hodgman, Reentrant polygon clipping, CACM 1974) and
 * gives how many corners are left, in order; 0: nothing. Where an edge is cut follows from its ends alone, whichever
 * triangle it belongs to, so that neighbours keep meeting there. */
int tc_clip(const tc_mesh_view *view, uint32_t planes, tc_clip_corner corners[TC_CLIP_MOST_CORNERS]);

#endif
