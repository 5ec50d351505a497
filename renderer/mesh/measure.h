/* Bounds and closedness of a mesh, and normals for a mesh without. */
#ifndef TC_MESH_MEASURE_H
#define TC_MESH_MEASURE_H

#include "renderer/mesh/mesh.h"

typedef struct tc_mesh_measures {
  double low[3], high[3]; /* bounding box of the vertices that triangles use, LPS mm */
  bool closed;            /* every edge has as many triangles on one side of it as on the other: no border */
} tc_mesh_measures;

/* The mesh keeps its box, so that a frame need not look at its vertices to see that it is outside the view. */
void tc_mesh_measure(tc_mesh *mesh, tc_mesh_measures *measures);

/* Unit vertex normals [n_vertices] for a mesh without, to free(): the mean of the triangles' normals weighted by area, which
 * shades a smooth surface smoothly however it is triangulated; along z where the area is 0. `goes_on` (NULL: never stops) stops
 * it within milliseconds. NULL: TC_ERROR_CANCELLED or TC_ERROR_MEMORY. */
float (*tc_mesh_normals_of(const tc_mesh *mesh, bool (*goes_on)(void *user), void *user, GError **error))[3];
/* The same, added to the mesh; on an error it still has none. */
bool tc_mesh_add_normals(tc_mesh *mesh, bool (*goes_on)(void *user), void *user, GError **error);

/* Closedness: a random point of the plane belongs to each vertex. The sum of the triangles' signed areas between these points,
 * modulo 2^64, is 0 if the mesh is closed, since it depends on the mesh's border only; otherwise it is not, but for one border in
 * about 2^31. */
typedef struct tc_mesh_point {
  uint32_t x, y;
} tc_mesh_point;

static inline tc_mesh_point tc_mesh_point_of(uint32_t vertex) {
  uint64_t x = (vertex + 0x9e3779b97f4a7c15u) * 0x7fb5d329728ea185u;
  x = (x ^ x >> 32) * 0x81dadef4bc2dd44du;
  x ^= x >> 29;
  return (tc_mesh_point){(uint32_t)x, (uint32_t)(x >> 32)};
}

static inline uint64_t tc_mesh_area_of(tc_mesh_point a, tc_mesh_point b, tc_mesh_point c) { /* twice the area */
  const uint64_t ux = (uint64_t)b.x - a.x, uy = (uint64_t)b.y - a.y, vx = (uint64_t)c.x - a.x, vy = (uint64_t)c.y - a.y;
  return ux * vy - uy * vx;
}

static inline uint64_t tc_mesh_triangle_sum(const uint32_t t[3]) {
  return tc_mesh_area_of(tc_mesh_point_of(t[0]), tc_mesh_point_of(t[1]), tc_mesh_point_of(t[2]));
}

#endif
