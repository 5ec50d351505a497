#include "renderer/mesh/coverage.h"

#include <math.h>
#include <string.h>

#include "renderer/mesh/clip.h"

/* Pixels within a triangle's outline; of one that passes the eye at most the whole picture. */
static double pixels_of(const tc_mesh_view *v, const tc_mesh *mesh, const uint32_t triangle[3]) {
  const double *cuts[5] = {v->planes[TC_VIEW_NEAR], v->sides[0], v->sides[1], v->sides[2], v->sides[3]}, all = (double)v->width * v->height;
  tc_clip_corner p[2][TC_CLIP_MOST_CORNERS];
  double at[TC_CLIP_MOST_CORNERS][2], twice = 0;
  int n = 3;
  for (int c = 0; c < 3; c++)
    for (int k = 0; k < 3; k++) p[0][c].at[k] = mesh->positions[triangle[c]][k];
  for (int i = 0; i < 5; i++) n = tc_clip_at(cuts[i], p[i % 2], n, p[1 - i % 2]);
  for (int i = 0; i < n; i++) {
    const double *from = p[1][i].at, scale = v->perspective ? v->scale / (tc_mesh_view_row(v->depth, from) + v->reference) : v->scale;
    at[i][0] = tc_mesh_view_row(v->right, from) * scale, at[i][1] = tc_mesh_view_row(v->down, from) * scale;
  }
  for (int i = 0; i < n; i++) twice += at[i][0] * at[(i + 1) % n][1] - at[i][1] * at[(i + 1) % n][0];
  return fabs(twice) < 2 * all ? fabs(twice) / 2 : n ? all : 0;
}

/* Any number from this one on, that is not in step with how a file puts its triangles. */
static size_t somewhere(uint64_t seed, size_t from, size_t to) {
  seed = (seed + 1) * 0x9e3779b97f4a7c15u;
  seed = (seed ^ seed >> 32) * 0xd6e8feb86659fd93u;
  return from + (size_t)((seed ^ seed >> 32) % (to - from));
}

double tc_mesh_coverage(const tc_mesh *mesh, const tc_camera *camera, int width, int height, size_t looks) {
  const size_t all = mesh->n_triangles, n = all < looks ? all : looks;
  tc_clusters about = {.radius = 1};
  tc_mesh_view view;
  double pixels = 0;
  memcpy(about.origin, mesh->origin, sizeof about.origin);
  tc_mesh_view_set_up(&view, &about, camera, width, height);
  for (size_t i = 0; i < n; i++)
    pixels += pixels_of(&view, mesh, mesh->triangles[somewhere(mesh->serial + i, i * all / n, (i + 1) * all / n)]);
  return n ? pixels * ((double)all / (double)n) : 0;
}
