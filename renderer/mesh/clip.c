#include "renderer/mesh/clip.h"

#include <string.h>

/* From the inner end on: both triangles of an edge see the same end as the inner one. */
static tc_clip_corner cross_plane(const tc_clip_corner *in, const tc_clip_corner *out, double d_in, double d_out) {
  tc_clip_corner c = {.original = -1};
  double share = d_in / (d_in - d_out);
  for (int k = 0; k < 3; k++) c.at[k] = in->at[k] + share * (out->at[k] - in->at[k]);
  return c;
}

int tc_clip_at(const double plane[4], const tc_clip_corner *from, int n, tc_clip_corner *to) {
  int made = 0;
  for (int i = 0; i < n; i++) {
    const tc_clip_corner *a = &from[i], *b = &from[(i + 1) % n];
    double da = tc_mesh_view_row(plane, a->at), db = tc_mesh_view_row(plane, b->at);
    if (da >= 0) to[made++] = *a;
    if ((da >= 0) == (db >= 0)) continue;
    to[made++] = da >= 0 ? cross_plane(a, b, da, db) : cross_plane(b, a, db, da);
  }
  return made;
}

int tc_clip(const tc_mesh_view *view, uint32_t planes, tc_clip_corner corners[TC_CLIP_MOST_CORNERS]) {
  tc_clip_corner other[TC_CLIP_MOST_CORNERS];
  int n = 3;
  for (int i = 0; i < view->n_planes && n; i++) {
    if (!(planes >> i & 1)) continue;
    n = tc_clip_at(view->planes[i], corners, n, other);
    memcpy(corners, other, (size_t)n * sizeof *corners);
  }
  return n;
}
