#include "renderer/mesh/mesh.h"

#include <stdlib.h>
#include <sys/mman.h>

uint64_t tc_mesh_bytes(size_t n_vertices, size_t n_triangles, bool normals) {
  return (uint64_t)n_vertices * (normals ? 6 : 3) * sizeof(float) + (uint64_t)n_triangles * 3 * sizeof(uint32_t);
}

void *tc_mesh_reserve(size_t n, size_t size) {
  const size_t page = (size_t)2 << 20, bytes = (n + 1) * size;
  if (bytes < page) return malloc(bytes);
  void *p = aligned_alloc(page, (bytes + page - 1) & ~(page - 1));
  if (p) madvise(p, bytes & ~(page - 1), MADV_HUGEPAGE);
  return p;
}

tc_mesh *tc_mesh_new(size_t n_vertices, size_t n_triangles, bool normals, GError **error) {
  if (n_vertices > UINT32_MAX || n_triangles > UINT32_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "mesh: %zu triangles are more than 2^32 - 1", n_triangles);
    return NULL;
  }
  tc_mesh *m = calloc(1, sizeof *m);
  if (m) {
    static uint64_t serial;
    m->serial = __atomic_add_fetch(&serial, 1, __ATOMIC_RELAXED);
    m->references = 1;
    m->n_vertices = n_vertices, m->n_triangles = n_triangles;
    m->bytes = (size_t)tc_mesh_bytes(n_vertices, n_triangles, normals);
    m->positions = tc_mesh_reserve(n_vertices, sizeof *m->positions);
    m->normals = normals ? tc_mesh_reserve(n_vertices, sizeof *m->normals) : NULL;
    m->triangles = tc_mesh_reserve(n_triangles, sizeof *m->triangles);
    if (m->positions && (m->normals || !normals) && m->triangles) return m;
  }
  tc_mesh_free(m);
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "mesh of %zu triangles: out of memory", n_triangles);
  return NULL;
}

tc_mesh *tc_mesh_ref(tc_mesh *mesh) {
  __atomic_add_fetch(&mesh->references, 1, __ATOMIC_RELAXED);
  return mesh;
}

void tc_mesh_free(tc_mesh *mesh) {
  if (!mesh || __atomic_sub_fetch(&mesh->references, 1, __ATOMIC_ACQ_REL) > 0) return;
  free(mesh->positions);
  free(mesh->normals);
  free(mesh->triangles);
  if (mesh->freed) mesh->freed(mesh->freed_user);
  free(mesh);
}
