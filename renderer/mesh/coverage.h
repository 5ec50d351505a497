/* How much of a picture a mesh's triangles cover, before anything of it is drawn. */
#ifndef TC_MESH_COVERAGE_H
#define TC_MESH_COVERAGE_H

#include "renderer/mesh/mesh.h"
#include "renderer/scene/scene.h"

/* Pixels of the picture that its triangles cover, summed over them, hidden or not. Exact for a mesh of `looks` triangles;
 * of a larger one so many are looked at, spread over all, and stand for the rest: what a quarter of the triangles cover is then
 * known within 10 % (looks = 1000), and what a few of many cover not at all. Pure; 0.2 microseconds a look. */
double tc_mesh_coverage(const tc_mesh *mesh, const tc_camera *camera, int width, int height, size_t looks);

#endif
