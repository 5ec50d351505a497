#include "renderer/mesh/measure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/base/reserve.h"

void tc_mesh_measure(tc_mesh *m, tc_mesh_measures *measures) {
  uint64_t border = 0;
  float low[3], high[3];
  for (int k = 0; k < 3; k++) low[k] = INFINITY, high[k] = -INFINITY;
  for (size_t i = 0; i < m->n_triangles; i++) {
    border += tc_mesh_triangle_sum(m->triangles[i]);
    for (int c = 0; c < 3; c++) {
      const uint32_t v = m->triangles[i][c];
      for (int k = 0; k < 3; k++) {
        low[k] = fminf(low[k], m->positions[v][k]);
        high[k] = fmaxf(high[k], m->positions[v][k]);
      }
    }
  }
  measures->closed = border == 0;
  m->boxed = m->n_triangles > 0;
  memcpy(m->low, low, sizeof low), memcpy(m->high, high, sizeof high);
  for (int k = 0; k < 3; k++) {
    measures->low[k] = m->n_triangles ? m->origin[k] + low[k] : 0;
    measures->high[k] = m->n_triangles ? m->origin[k] + high[k] : 0;
  }
}

/* Twice the area, as a vector. */
static void add_face(const tc_mesh *m, const uint32_t t[3], float (*normals)[3]) {
  const float *a = m->positions[t[0]], *b = m->positions[t[1]], *c = m->positions[t[2]];
  float u[3], v[3];
  for (int k = 0; k < 3; k++) u[k] = b[k] - a[k], v[k] = c[k] - a[k];
  for (int k = 0; k < 3; k++) {
    const float n = u[(k + 1) % 3] * v[(k + 2) % 3] - u[(k + 2) % 3] * v[(k + 1) % 3];
    for (int i = 0; i < 3; i++) normals[t[i]][k] += n;
  }
}

static void make_unit(float n[3]) {
  const double length = sqrt((double)n[0] * n[0] + (double)n[1] * n[1] + (double)n[2] * n[2]);
  const bool sound = isfinite(length) && length > 0;
  for (int k = 0; k < 3; k++) n[k] = sound ? (float)(n[k] / length) : k == 2;
}

float (*tc_mesh_normals_of(const tc_mesh *m, bool (*goes_on)(void *user), void *user, GError **error))[3] {
  enum { PORTION = 1 << 16 };
  float (*normals)[3] = tc_reserve(m->n_vertices, sizeof *normals);
  if (!normals) tc_set_error(error, TC_ERROR_MEMORY, NULL, "normals of %zu vertices: out of memory", m->n_vertices);
  for (size_t i = 0; normals && i < 2 * m->n_vertices + m->n_triangles; i++) {
    const size_t t = i - m->n_vertices, v = t - m->n_triangles; /* meaningless before their turn */
    if (i % PORTION == 0 && goes_on && !goes_on(user)) {
      free(normals);
      tc_set_error(error, TC_ERROR_CANCELLED, NULL, "cancelled");
      return NULL;
    }
    if (i < m->n_vertices) memset(normals[i], 0, sizeof *normals);
    else if (t < m->n_triangles) add_face(m, m->triangles[t], normals);
    else make_unit(normals[v]);
  }
  return normals;
}

bool tc_mesh_add_normals(tc_mesh *m, bool (*goes_on)(void *user), void *user, GError **error) {
  m->normals = tc_mesh_normals_of(m, goes_on, user, error);
  if (m->normals) m->bytes += m->n_vertices * sizeof *m->normals;
  return m->normals != NULL;
}
