/* Clusters of several surfaces: parts that are added, appended and copied (clusters.h). */
#include "renderer/mesh/clusters_join.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

uint64_t tc_clusters_next_serial(void) {
  static atomic_uint_fast64_t serials;
  return atomic_fetch_add(&serials, 1) + 1;
}

bool tc_clusters_no_memory(GError **error) {
  tc_set_error(error, TC_ERROR_MEMORY, NULL, "clusters of a mesh: out of memory");
  return false;
}

size_t tc_clusters_array_bytes(const tc_clusters *c) {
  return c->n * sizeof *c->clusters + c->vertex_room * (12 + (c->normals ? 4 : 0) + (c->colors ? 4 : 0)) + 3 * c->triangle_room;
}

/* The sphere around both. */
static void join_spheres(tc_clusters *to, const tc_clusters *more) {
  float apart = 0;
  for (int k = 0; k < 3; k++) apart += (more->centre[k] - to->centre[k]) * (more->centre[k] - to->centre[k]);
  apart = sqrtf(apart);
  if (apart + more->radius <= to->radius) return;
  const bool within = apart + to->radius <= more->radius;
  const float radius = within ? more->radius : 0.5f * (apart + to->radius + more->radius);
  const float share = within ? 1 : apart > 0 ? (radius - to->radius) / apart : 0;
  for (int k = 0; k < 3; k++) to->centre[k] += share * (more->centre[k] - to->centre[k]);
  to->radius = radius * (1 + 1e-5f);
}

/* A block of bytes that grows by another; false: as it was. */
static bool grow(void *block, size_t bytes, const void *more, size_t more_bytes, size_t over) {
  void *grown = realloc(*(void **)block, bytes + more_bytes + over);
  if (!grown) return false;
  *(void **)block = grown;
  if (more_bytes) memcpy((char *)grown + bytes, more, more_bytes);
  memset((char *)grown + bytes + more_bytes, 0, over);
  return true;
}

/* Where only one of both has colours the other's are 0: nobody reads them. */
static bool grow_colors(tc_clusters *to, const tc_clusters *more, size_t over) {
  const size_t own = to->vertex_room * sizeof *to->colors, added = more->vertex_room * sizeof *more->colors;
  if (!to->colors && !more->colors) return true;
  if (!to->colors && !grow(&to->colors, 0, NULL, 0, own)) return false;
  return more->colors ? grow(&to->colors, own, more->colors, added, over) : grow(&to->colors, own, NULL, 0, added + over);
}

bool tc_clusters_append(tc_clusters *to, const tc_clusters *more, GError **error) {
  const size_t over = 16 * TC_CLUSTER_PAD, arrays = tc_clusters_array_bytes(to);
  if (to->vertex_room + more->vertex_room > UINT32_MAX || to->triangle_room + more->triangle_room > UINT32_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "clusters of a mesh: %zu triangles are too many", to->n_triangles + more->n_triangles);
    return false;
  }
  if (!grow(&to->clusters, to->n * sizeof *to->clusters, more->clusters, more->n * sizeof *more->clusters, sizeof *to->clusters) ||
      !grow(&to->positions, to->vertex_room * 12, more->positions, more->vertex_room * 12, over) ||
      (more->normals && !grow(&to->normals, to->vertex_room * 4, more->normals, more->vertex_room * 4, over)) ||
      !grow_colors(to, more, over) ||
      !grow(&to->triangles, to->triangle_room * 3, more->triangles, more->triangle_room * 3, over))
    return tc_clusters_no_memory(error);
  for (size_t i = to->n; i < to->n + more->n; i++) {
    to->clusters[i].vertex += (uint32_t)to->vertex_room;
    to->clusters[i].triangle += (uint32_t)to->triangle_room;
  }
  to->n += more->n, to->n_triangles += more->n_triangles;
  to->vertex_room += more->vertex_room, to->triangle_room += more->triangle_room;
  to->bytes += tc_clusters_array_bytes(to) - arrays;
  to->serial = tc_clusters_next_serial();
  return true;
}

static bool append_part(tc_clusters *to, tc_clusters *more, GError **error) {
  tc_part part = more->parts[0];
  part.first = to->n;
  if (to->n_parts >= UINT16_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "clusters of a mesh: %zu surfaces are too many", to->n_parts + 1);
    return false;
  }
  for (size_t i = 0; i < more->n; i++) more->clusters[i].part = (uint16_t)to->n_parts;
  if (!grow(&to->parts, to->n_parts * sizeof part, &part, sizeof part, 0)) return tc_clusters_no_memory(error);
  if (!tc_clusters_append(to, more, error)) return false;
  to->n_parts++;
  join_spheres(to, more);
  return true;
}

tc_clusters *tc_clusters_none(const tc_clusters *like, GError **error) {
  static const tc_clusters nothing = {0};
  tc_clusters *none = calloc(1, sizeof *none);
  if (!none) {
    tc_clusters_no_memory(error);
    return NULL;
  }
  memcpy(none->origin, like->origin, sizeof none->origin);
  if (tc_clusters_append(none, &nothing, error)) return none;
  tc_clusters_free(none);
  return NULL;
}

bool tc_clusters_add(tc_clusters **all, tc_clusters *more, const tc_mesh_source *of, GError **error) {
  bool added = true;
  more->parts[0].of = *of;
  more->parts[0].of.mesh = NULL;
  if (!*all) {
    *all = more;
  } else {
    added = append_part(*all, more, error);
    tc_clusters_free(more);
  }
  return added;
}

/* The sphere about clusters' own: their centres' box and the farthest of them. */
static void bound_clusters(tc_clusters *c) {
  float lo[3] = {INFINITY, INFINITY, INFINITY}, hi[3] = {-INFINITY, -INFINITY, -INFINITY};
  c->radius = 0;
  for (size_t i = 0; i < c->n; i++)
    for (int k = 0; k < 3; k++) {
      lo[k] = lesser(lo[k], c->clusters[i].centre[k] - c->clusters[i].radius);
      hi[k] = greater(hi[k], c->clusters[i].centre[k] + c->clusters[i].radius);
    }
  for (int k = 0; k < 3; k++) c->centre[k] = c->n ? 0.5f * (lo[k] + hi[k]) : 0;
  for (size_t i = 0; i < c->n; i++) {
    float square = 0;
    for (int k = 0; k < 3; k++)
      square += (c->clusters[i].centre[k] - c->centre[k]) * (c->clusters[i].centre[k] - c->centre[k]);
    c->radius = greater(c->radius, (sqrtf(square) + c->clusters[i].radius) * (1 + 1e-5f));
  }
}

static bool copy_arrays(tc_clusters *to, const tc_clusters *all, const tc_cluster *from, bool colored) {
  const size_t over = 16 * TC_CLUSTER_PAD;
  return grow(&to->clusters, 0, from, to->n * sizeof *from, sizeof *from) &&
         grow(&to->positions, 0, all->positions + 3 * (size_t)from->vertex, to->vertex_room * 12, over) &&
         (!all->normals || grow(&to->normals, 0, all->normals + from->vertex, to->vertex_room * 4, over)) &&
         (!colored || grow(&to->colors, 0, all->colors + from->vertex, to->vertex_room * 4, over)) &&
         grow(&to->triangles, 0, all->triangles + 3 * (size_t)from->triangle, to->triangle_room * 3, over) &&
         (to->parts = calloc(1, sizeof *to->parts));
}

tc_clusters *tc_clusters_copy_part(const tc_clusters *all, size_t part, GError **error) {
  static const tc_cluster none = {0};
  const tc_part *p = &all->parts[part];
  tc_clusters *to = calloc(1, sizeof *to);
  const tc_cluster *from = p->n ? &all->clusters[p->first] : &none, *last = from + (p->n ? p->n - 1 : 0);
  if (to) {
    memcpy(to->origin, all->origin, sizeof to->origin);
    to->serial = tc_clusters_next_serial();
    to->n = p->n, to->n_parts = 1;
    to->vertex_room = last->vertex + tc_cluster_padded(last->n_vertices) - from->vertex;
    to->triangle_room = last->triangle + tc_cluster_padded(last->n_triangles) - from->triangle;
  }
  if (!to || !copy_arrays(to, all, from, p->colored)) {
    tc_clusters_free(to);
    tc_clusters_no_memory(error);
    return NULL;
  }
  to->parts[0] = (tc_part){.of = p->of, .n = p->n, .colored = p->colored, .closed = p->closed};
  for (size_t i = 0; i < to->n; i++) {
    to->clusters[i].vertex -= from->vertex, to->clusters[i].triangle -= from->triangle;
    to->clusters[i].part = 0, to->clusters[i].group = 0;
    to->n_triangles += to->clusters[i].n_triangles;
  }
  to->bytes = tc_clusters_array_bytes(to);
  bound_clusters(to);
  return to;
}

void tc_clusters_free(tc_clusters *clusters) {
  if (!clusters) return;
  free(clusters->groups);
  free(clusters->parts);
  free(clusters->clusters);
  free(clusters->positions);
  free(clusters->normals);
  free(clusters->colors);
  free(clusters->triangles);
  free(clusters);
}
