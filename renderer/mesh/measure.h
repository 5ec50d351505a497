/* What a mesh is like as a whole, and the normals of one that came without. */
#ifndef TC_MESH_MEASURE_H
#define TC_MESH_MEASURE_H

#include "renderer/mesh/mesh.h"

typedef struct tc_mesh_measures {
  double low[3], high[3]; /* of the vertices that triangles have, LPS mm */
  bool closed;            /* every edge has as many triangles on one side of it as on the other: no border */
} tc_mesh_measures;

void tc_mesh_measure(const tc_mesh *mesh, tc_mesh_measures *measures);

/* Unit normals of the vertices of a mesh that has none: its triangles' by area, so that a smooth surface is shaded smoothly
 * however it was cut. Where there is no area, along z. `goes_on` (NULL: always) ends it within milliseconds
 * (TC_ERROR_CANCELLED); TC_ERROR_MEMORY. Then the mesh still has none. */
bool tc_mesh_add_normals(tc_mesh *mesh, bool (*goes_on)(void *user), void *user, GError **error);

/* Of an edge: what its other direction takes away again. A sum over all edges of all triangles is 0 where there is no border. */
static inline uint64_t tc_mesh_edge_sum(uint32_t a, uint32_t b) {
  uint64_t x = a < b ? (uint64_t)a << 32 | b : (uint64_t)b << 32 | a;
  x = (x ^ x >> 31) * 0x7fb5d329728ea185u;
  x = (x ^ x >> 27) * 0x81dadef4bc2dd44du;
  x ^= x >> 33;
  return a == b ? 0 : a < b ? x : 0 - x;
}

#endif
