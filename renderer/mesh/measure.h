/* Bounds and closedness of a mesh, and normals for a mesh without. */
#ifndef TC_MESH_MEASURE_H
#define TC_MESH_MEASURE_H

#include "renderer/mesh/mesh.h"

typedef struct tc_mesh_measures {
  double low[3], high[3]; /* bounding box of the vertices that triangles use, LPS mm */
  bool closed;            /* every edge has as many triangles on one side of it as on the other: no border */
} tc_mesh_measures;

void tc_mesh_measure(const tc_mesh *mesh, tc_mesh_measures *measures);

/* Adds unit vertex normals to a mesh without: the mean of the triangles' normals weighted by area, which shades a smooth
 * surface smoothly however it is triangulated; along z where the area is 0. `goes_on` (NULL: never stops) stops it within
 * milliseconds (TC_ERROR_CANCELLED); on that or TC_ERROR_MEMORY the mesh still has no normals. */
bool tc_mesh_add_normals(tc_mesh *mesh, bool (*goes_on)(void *user), void *user, GError **error);

/* A hash of a directed edge; the opposite direction has the negative hash. The sum over all edges of a closed mesh is 0. */
static inline uint64_t tc_mesh_edge_sum(uint32_t a, uint32_t b) {
  uint64_t x = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
  x = (x ^ x >> 31) * 0x7fb5d329728ea185u;
  x = (x ^ x >> 27) * 0x81dadef4bc2dd44du;
  x ^= x >> 33;
  return a == b ? 0 : a < b ? x : 0 - x;
}

#endif
