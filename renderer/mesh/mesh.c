#include "renderer/mesh/mesh.h"

#include <stdlib.h>

uint64_t tc_mesh_bytes(size_t n_vertices, size_t n_triangles, bool normals) {
  return (uint64_t)n_vertices * (normals ? 6 : 3) * sizeof(float) + (uint64_t)n_triangles * 3 * sizeof(uint32_t);
}

tc_mesh *tc_mesh_new(size_t n_vertices, size_t n_triangles, bool normals, GError **error) {
  if (n_vertices > UINT32_MAX || n_triangles > UINT32_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "mesh: %zu triangles are more than 2^32 - 1", n_triangles);
    return NULL;
  }
  tc_mesh *m = calloc(1, sizeof *m);
  if (m) {
    m->n_vertices = n_vertices, m->n_triangles = n_triangles;
    m->bytes = (size_t)tc_mesh_bytes(n_vertices, n_triangles, normals);
    m->positions = malloc((n_vertices + 1) * sizeof *m->positions); /* one more: never of size 0 */
    m->normals = normals ? malloc((n_vertices + 1) * sizeof *m->normals) : NULL;
    m->triangles = malloc((n_triangles + 1) * sizeof *m->triangles);
    if (m->positions && (m->normals || !normals) && m->triangles) return m;
  }
  tc_mesh_free(m);
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "mesh of %zu triangles: out of memory", n_triangles);
  return NULL;
}

void tc_mesh_free(tc_mesh *mesh) {
  if (!mesh) return;
  free(mesh->positions);
  free(mesh->normals);
  free(mesh->triangles);
  free(mesh);
}
