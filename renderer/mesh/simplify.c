/* Simplification of meshes (mesh.h), by meshoptimizer. It collapses edges, and at a narrow neck may let a surface meet itself in
 * an edge or a vertex. Where a vertex whose triangles were one fan has several afterwards, the triangles around it are kept,
 * and the rest is simplified anew with its border locked, until there is none. */
#include <math.h>
#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/mesh.h"

/* ---- fans ---- */

/* Flags of a vertex: several fans before the simplification, which is not to be mended; all its triangles are kept. */
enum { BROKEN = 1, KEPT = 2 };

typedef struct corner {
  uint32_t next, last; /* the triangle's other vertices, in its order */
} corner;

typedef struct fans {
  size_t *first;   /* [n_vertices + 1] corners of each vertex */
  corner *corners; /* [3 n] */
  uint32_t *starts, *ends, *last_of; /* [n_vertices] of a vertex: the vertex + 1 whose corner begins, or ends there */
  uint8_t *flags;  /* [n_vertices] */
} fans;

static void free_fans(fans *f) { free(f->first), free(f->corners), free(f->starts), free(f->ends), free(f->last_of), free(f->flags); }

static bool make_fans(const tc_mesh *of, fans *f) {
  f->first = malloc((of->n_vertices + 2) * sizeof *f->first), f->corners = malloc((3 * of->n_triangles + 1) * sizeof *f->corners);
  f->starts = malloc((of->n_vertices + 1) * sizeof *f->starts), f->ends = malloc((of->n_vertices + 1) * sizeof *f->ends);
  f->last_of = malloc((of->n_vertices + 1) * sizeof *f->last_of), f->flags = calloc(of->n_vertices + 1, 1);
  return f->first && f->corners && f->starts && f->ends && f->last_of && f->flags;
}

static void sort_corners(fans *f, size_t n_vertices, const uint32_t (*triangles)[3], size_t n) {
  memset(f->first, 0, (n_vertices + 2) * sizeof *f->first);
  for (size_t i = 0; i < 3 * n; i++) f->first[triangles[i / 3][i % 3] + 2]++;
  for (size_t v = 0; v < n_vertices; v++) f->first[v + 2] += f->first[v + 1];
  for (size_t i = 0; i < 3 * n; i++) {
    const uint32_t *t = triangles[i / 3];
    f->corners[f->first[t[i % 3] + 1]++] = (corner){t[(i + 1) % 3], t[(i + 2) % 3]};
  }
}

/* Whether the vertex has no triangles, or one fan, closed or open. An edge that ends there twice shows at its other end. */
static bool is_one_fan(fans *f, uint32_t v) {
  const corner *c = f->corners + f->first[v];
  const size_t n = f->first[v + 1] - f->first[v];
  if (!n) return true;
  for (size_t i = 0; i < n; i++) {
    if (f->starts[c[i].next] == v + 1) return false; /* an edge that starts here twice */
    f->starts[c[i].next] = f->ends[c[i].last] = v + 1;
    f->last_of[c[i].next] = c[i].last;
  }
  size_t begin = 0, met = 0;
  while (begin < n && f->ends[c[begin].next] == v + 1) begin++;
  for (uint32_t at = c[begin < n ? begin : 0].next; met < n && f->starts[at] == v + 1; met++) {
    f->starts[at] = 0;
    at = f->last_of[at];
  }
  return met == n;
}

/* Flags vertices with several fans that have none of the flags yet. Returns their number. */
static size_t flag_broken(fans *f, size_t n_vertices, const uint32_t (*triangles)[3], size_t n, uint8_t flag) {
  size_t broken = 0;
  sort_corners(f, n_vertices, triangles, n);
  memset(f->starts, 0, n_vertices * sizeof *f->starts), memset(f->ends, 0, n_vertices * sizeof *f->ends);
  for (uint32_t v = 0; v < n_vertices; v++)
    if (!f->flags[v] && !is_one_fan(f, v)) f->flags[v] = flag, broken++;
  return broken;
}

/* ---- triangles ---- */

/* Moves triangles with a kept vertex behind the others, whose number is returned. */
static size_t part(const tc_mesh *of, const uint8_t *flags, uint32_t (*to)[3]) {
  size_t rest = 0, kept = of->n_triangles;
  for (size_t t = 0; t < of->n_triangles; t++) {
    const uint32_t *v = of->triangles[t];
    const bool keeps = flags[v[0]] == KEPT || flags[v[1]] == KEPT || flags[v[2]] == KEPT;
    memcpy(to[keeps ? --kept : rest++], v, 3 * sizeof *v);
  }
  return rest;
}

/* Simplifies the first n triangles in place. Returns how many are left. */
static size_t collapse(const tc_mesh *of, uint32_t (*triangles)[3], size_t n, size_t least, float error, bool lock_border) {
  const float *at = &of->positions[0][0], extent = n ? meshopt_simplifyScale(at, of->n_vertices, sizeof *of->positions) : 0;
  const unsigned options = lock_border ? meshopt_SimplifyLockBorder : 0;
  if (!(extent > 0)) return n;
  return meshopt_simplify(triangles[0], triangles[0], 3 * n, at, of->n_vertices, sizeof *of->positions, 3 * MIN(least, n),
                          fminf(error / extent, 1), options, NULL) / 3;
}

/* Writes the triangles left to to[n_triangles] and returns their number; SIZE_MAX: no memory. */
static size_t simplify(const tc_mesh *of, float error, size_t least, uint32_t (*to)[3]) {
  fans f = {0};
  size_t left = SIZE_MAX;
  if (make_fans(of, &f)) {
    flag_broken(&f, of->n_vertices, (const uint32_t(*)[3])of->triangles, of->n_triangles, BROKEN);
    do {
      const size_t rest = part(of, f.flags, to), kept = of->n_triangles - rest;
      left = collapse(of, to, rest, least > kept ? least - kept : 0, error, kept > 0);
      memmove(to + left, to + rest, kept * sizeof *to);
      left += kept;
    } while (flag_broken(&f, of->n_vertices, (const uint32_t(*)[3])to, left, KEPT));
  }
  free_fans(&f);
  return left;
}

/* ---- meshes ---- */

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
  uint32_t (*left)[3] = malloc((mesh->n_triangles + 1) * sizeof *left);
  const size_t n = left ? simplify(mesh, (float)error_mm, least, left) : SIZE_MAX;
  tc_mesh *small = NULL;
  if (n == SIZE_MAX)
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "simplification: out of memory");
  else
    small = compact(mesh, left[0], n, error);
  free(left);
  return small;
}
