/* Clipping of triangles at the near plane, the guard-band planes and the scene's clip planes. */
#ifndef TC_MESH_CLIP_H
#define TC_MESH_CLIP_H

#include "renderer/mesh/view.h"

enum { TC_CLIP_MOST_CORNERS = 3 + TC_VIEW_PLANES };

typedef struct tc_clip_corner {
  double at[3];  /* relative to the mesh's origin */
  int original;  /* number of the triangle's corner; -1: a point where a plane cuts an edge */
} tc_clip_corner;

/* Cuts corners[3] at the planes whose bits are set (Sutherland and Hodgman, Reentrant polygon clipping, CACM 1974) and
 * returns the number of corners of the remaining polygon, in order; 0: nothing remains. The cut point of an edge is computed
 * from its two ends alone, in the same order for both of its triangles, so that neighbours stay watertight. */
int tc_clip(const tc_mesh_view *view, uint32_t planes, tc_clip_corner corners[TC_CLIP_MOST_CORNERS]);

/* The same at one plane: from[n] to to[], whose number is returned: at most one more of a convex polygon. */
int tc_clip_at(const double plane[4], const tc_clip_corner *from, int n, tc_clip_corner *to);

#endif
