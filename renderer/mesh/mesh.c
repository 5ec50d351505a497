#include "renderer/mesh/mesh.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/base/reserve.h"

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
    static uint64_t serial;
    m->serial = __atomic_add_fetch(&serial, 1, __ATOMIC_RELAXED);
    m->references = 1;
    m->n_vertices = n_vertices, m->n_triangles = n_triangles;
    m->bytes = (size_t)tc_mesh_bytes(n_vertices, n_triangles, normals);
    m->positions = tc_reserve(n_vertices, sizeof *m->positions);
    m->normals = normals ? tc_reserve(n_vertices, sizeof *m->normals) : NULL;
    m->triangles = tc_reserve(n_triangles, sizeof *m->triangles);
    if (m->positions && (m->normals || !normals) && m->triangles) return m;
  }
  tc_mesh_free(m);
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "mesh of %zu triangles: out of memory", n_triangles);
  return NULL;
}

bool tc_mesh_add_colors(tc_mesh *m, GError **error) {
  m->colors = tc_reserve(m->n_vertices, sizeof *m->colors);
  if (!m->colors) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "colours of %zu vertices: out of memory", m->n_vertices);
    return false;
  }
  m->bytes += m->n_vertices * TC_MESH_COLOR_BYTES;
  return true;
}

static void append(tc_mesh *to, const tc_mesh *more, size_t vertex, size_t triangle) {
  for (size_t v = 0; v < more->n_vertices; v++)
    for (int k = 0; k < 3; k++)
      to->positions[vertex + v][k] = (float)(more->positions[v][k] + (more->origin[k] - to->origin[k]));
  if (to->normals) memcpy(to->normals + vertex, more->normals, more->n_vertices * sizeof *more->normals);
  for (size_t v = 0; to->colors && v < more->n_vertices; v++) to->colors[vertex + v] = more->colors ? more->colors[v] : 0xffffff;
  for (size_t t = 0; t < more->n_triangles; t++)
    for (int c = 0; c < 3; c++) to->triangles[triangle + t][c] = (uint32_t)vertex + more->triangles[t][c];
}

tc_mesh *tc_mesh_join(tc_mesh *const *of, size_t n, GError **error) {
  size_t vertices = 0, triangles = 0;
  bool normals = true, colors = false;
  for (size_t i = 0; i < n; i++) {
    vertices += of[i]->n_vertices, triangles += of[i]->n_triangles;
    normals = normals && of[i]->normals, colors = colors || of[i]->colors;
  }
  tc_mesh *all = tc_mesh_new(vertices, triangles, normals, error);
  if (!all || (colors && !tc_mesh_add_colors(all, error))) {
    tc_mesh_free(all);
    return NULL;
  }
  if (n) memcpy(all->origin, of[0]->origin, sizeof all->origin);
  for (size_t i = 0, vertex = 0, triangle = 0; i < n; i++) {
    append(all, of[i], vertex, triangle);
    vertex += of[i]->n_vertices, triangle += of[i]->n_triangles;
  }
  return all;
}

bool tc_mesh_drop_unused(tc_mesh *m, GError **error) {
  uint32_t *number = calloc(m->n_vertices ? m->n_vertices : 1, sizeof *number), n = 0;
  if (!number) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "mesh: out of memory");
    return false;
  }
  for (size_t t = 0; t < m->n_triangles; t++)
    for (int k = 0; k < 3; k++) number[m->triangles[t][k]] = 1;
  for (size_t i = 0; i < m->n_vertices; i++) {
    if (!number[i]) continue;
    memmove(m->positions[n], m->positions[i], sizeof *m->positions);
    if (m->normals) memmove(m->normals[n], m->normals[i], sizeof *m->normals);
    number[i] = n++;
  }
  for (size_t t = 0; t < m->n_triangles; t++)
    for (int k = 0; k < 3; k++) m->triangles[t][k] = number[m->triangles[t][k]];
  m->n_vertices = n;
  free(number);
  return true;
}

tc_mesh *tc_mesh_ref(tc_mesh *mesh) {
  __atomic_add_fetch(&mesh->references, 1, __ATOMIC_RELAXED);
  return mesh;
}

void tc_mesh_free(tc_mesh *mesh) {
  if (!mesh || __atomic_sub_fetch(&mesh->references, 1, __ATOMIC_ACQ_REL) > 0) return;
  free(mesh->positions);
  free(mesh->normals);
  free(mesh->colors);
  free(mesh->triangles);
  if (mesh->freed) mesh->freed(mesh->freed_user);
  free(mesh);
}
