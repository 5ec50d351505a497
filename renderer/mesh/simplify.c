/* Simplification of meshes (mesh.h), by meshoptimizer. */
#include <math.h>
#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/mesh.h"

/* Mesh of the given triangles with the vertices that they use, in order of first use. */
static tc_mesh *compact(const tc_mesh *from, const uint32_t *triangles, size_t n_triangles, GError **error) {
  uint32_t *places = malloc((from->n_vertices + 1) * sizeof *places);
  if (!places) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "simplification: out of memory");
    return NULL;
  }
  const size_t used = meshopt_optimizeVertexFetchRemap(places, triangles, 3 * n_triangles, from->n_vertices);
  tc_mesh *mesh = tc_mesh_new(used, n_triangles, from->normals != NULL, error);
  if (mesh && from->colors && !tc_mesh_add_colors(mesh, error)) g_clear_pointer(&mesh, tc_mesh_free);
  if (mesh) {
    memcpy(mesh->origin, from->origin, sizeof mesh->origin);
    meshopt_remapIndexBuffer(&mesh->triangles[0][0], triangles, 3 * n_triangles, places);
    meshopt_remapVertexBuffer(mesh->positions, from->positions, from->n_vertices, sizeof *from->positions, places);
    if (from->normals)
      meshopt_remapVertexBuffer(mesh->normals, from->normals, from->n_vertices, sizeof *from->normals, places);
    if (from->colors)
      meshopt_remapVertexBuffer(mesh->colors, from->colors, from->n_vertices, sizeof *from->colors, places);
  }
  free(places);
  return mesh;
}

tc_mesh *tc_mesh_simplify(const tc_mesh *mesh, double error_mm, size_t least, GError **error) {
  if (!(error_mm >= 0)) {
    tc_set_error(error, TC_ERROR_INVALID, NULL, "simplification: an error of at least 0 mm expected");
    return NULL;
  }
  uint32_t *left = malloc((3 * mesh->n_triangles + 1) * sizeof *left);
  if (!left) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "simplification: out of memory");
    return NULL;
  }
  const size_t corners = 3 * mesh->n_triangles, stride = sizeof *mesh->positions;
  const float *at = &mesh->positions[0][0];
  size_t n = 0;
  if (corners > 0) {
    const float extent = meshopt_simplifyScale(at, mesh->n_vertices, stride);
    const float relative = extent > 0 ? (float)fmin(error_mm / (double)extent, 1) : 0;
    n = meshopt_simplify(left, &mesh->triangles[0][0], corners, at, mesh->n_vertices, stride,
                         3 * MIN(least, mesh->n_triangles), relative, 0, NULL);
  }
  tc_mesh *small = compact(mesh, left, n / 3, error);
  free(left);
  return small;
}
