/* Estimate of how many pixels a mesh's triangles cover, before the mesh is drawn. */
#ifndef TC_MESH_COVERAGE_H
#define TC_MESH_COVERAGE_H

#include "renderer/mesh/mesh.h"
#include "renderer/scene/scene.h"

/* Sum over all triangles, visible or hidden, of the pixels that each covers. Exact for a mesh of at most `looks` triangles;
 * from a larger mesh `looks` triangles are sampled evenly. With looks = 1000 the error is within 10 % where a quarter of the
 * triangles cover pixels; a few large triangles among many are missed. Pure; 0.2 microseconds a triangle. */
double tc_mesh_coverage(const tc_mesh *mesh, const tc_camera *camera, int width, int height, size_t looks);

#endif
