/* Rays against a mesh: triangles in Morton order of their middles, halved again and again, with a box around each half.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/reference/internal.h"
#include "renderer/reference/reference.h"

#define LEAF 4
#define APART 1e-6 /* mm: hits nearer than this are one, of triangles that share the edge */

typedef struct node {
  float low[3], high[3];
  uint32_t first, n; /* triangles of a leaf; n 0: children are the next node and `first` */
} node;

struct tc_ref_triangles {
  double origin[3];
  float (*positions)[3], (*normals)[3];
  uint32_t (*triangles)[3], *colors;
  bool linear;
  node *nodes;
  uint32_t n_nodes;
};

typedef struct placed {
  uint64_t code;
  uint32_t triangle;
} placed;

static uint64_t spread(uint64_t x) { /* 21 bits, two zeros between each */
  for (int i = 0; i < 5; i++) {
    static const uint64_t masks[5] = {0x1f00000000ffff, 0x1f0000ff0000ff, 0x100f00f00f00f00f, 0x10c30c30c30c30c3,
                                      0x1249249249249249};
    x = (x | x << (32 >> i)) & masks[i];
  }
  return x;
}

static int by_code(const void *a, const void *b) {
  const placed *p = a, *q = b;
  return p->code < q->code ? -1 : p->code > q->code;
}

static placed *sort_triangles(const tc_reference_mesh *m) {
  double low[3] = {INFINITY, INFINITY, INFINITY}, wide = 0;
  placed *order = malloc((m->n_triangles + 1) * sizeof *order);
  for (size_t v = 0; v < m->n_vertices; v++)
    for (int k = 0; k < 3; k++) low[k] = fmin(low[k], (double)m->positions[v][k]);
  for (size_t v = 0; v < m->n_vertices; v++)
    for (int k = 0; k < 3; k++) wide = fmax(wide, (double)m->positions[v][k] - low[k]);
  for (size_t t = 0; t < m->n_triangles && order; t++) {
    order[t] = (placed){0, (uint32_t)t};
    for (int k = 0; k < 3; k++) {
      double middle = 0;
      for (int c = 0; c < 3; c++) middle += (double)m->positions[m->triangles[t][c]][k] / 3;
      order[t].code |= spread((uint64_t)(fmax((middle - low[k]) / wide, 0) * 0x1fffff)) << k;
    }
  }
  if (order) qsort(order, m->n_triangles, sizeof *order, by_code);
  return order;
}

static uint32_t build(tc_ref_triangles *m, uint32_t first, uint32_t end) {
  const uint32_t at = m->n_nodes++, middle = first + (end - first) / 2;
  node own = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, first, end - first};
  if (own.n > LEAF) {
    const uint32_t children[2] = {build(m, first, middle), build(m, middle, end)};
    for (int i = 0; i < 2; i++)
      for (int k = 0; k < 3; k++) {
        own.low[k] = fminf(own.low[k], m->nodes[children[i]].low[k]);
        own.high[k] = fmaxf(own.high[k], m->nodes[children[i]].high[k]);
      }
    own.first = children[1], own.n = 0;
  }
  for (uint32_t i = first; i < first + own.n; i++)
    for (int k = 0; k < 9; k++) {
      const float x = m->positions[m->triangles[i][k / 3]][k % 3];
      own.low[k % 3] = fminf(own.low[k % 3], x), own.high[k % 3] = fmaxf(own.high[k % 3], x);
    }
  m->nodes[at] = own;
  return at;
}

static void *copy(const void *from, size_t n, size_t size) {
  void *to = from ? malloc((n + 1) * size) : NULL;
  if (to) memcpy(to, from, n * size);
  return to;
}

tc_ref_triangles *tc_ref_triangles_new(const tc_reference_mesh *of, bool linear) {
  tc_ref_triangles *m = g_new0(tc_ref_triangles, 1);
  placed *order = sort_triangles(of);
  memcpy(m->origin, of->origin, sizeof m->origin);
  m->positions = copy(of->positions, of->n_vertices, sizeof *m->positions);
  m->normals = copy(of->normals, of->n_vertices, sizeof *m->normals);
  m->colors = copy(of->colors, of->n_vertices, sizeof *m->colors), m->linear = linear;
  m->triangles = malloc((of->n_triangles + 1) * sizeof *m->triangles);
  m->nodes = malloc((of->n_triangles + 1) * sizeof *m->nodes);
  const bool good = order && m->positions && (m->normals || !of->normals) && (m->colors || !of->colors) && m->triangles && m->nodes;
  for (size_t t = 0; t < of->n_triangles && good; t++)
    memcpy(m->triangles[t], of->triangles[order[t].triangle], sizeof *m->triangles);
  if (good && of->n_triangles) build(m, 0, (uint32_t)of->n_triangles);
  free(order);
  if (good) return m;
  tc_ref_triangles_free(m);
  return NULL;
}

void tc_ref_triangles_free(tc_ref_triangles *m) {
  if (!m) return;
  free(m->positions), free(m->normals), free(m->colors), free(m->triangles), free(m->nodes);
  g_free(m);
}

static void cross(const double a[3], const double b[3], double c[3]) {
  for (int k = 0; k < 3; k++) c[k] = a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3];
}

static double dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static bool meets(const node *n, const double from[3], const double along[3], double enter, double leave) {
  for (int k = 0; k < 3; k++) {
    const double a = ((double)n->low[k] - from[k]) / along[k], b = ((double)n->high[k] - from[k]) / along[k];
    if (along[k] == 0) { /* no quotient */
      if (from[k] < (double)n->low[k] || from[k] > (double)n->high[k]) return false;
      continue;
    }
    enter = fmax(enter, fmin(a, b) - APART), leave = fmin(leave, fmax(a, b) + APART);
  }
  return enter <= leave;
}

static double channel(const tc_ref_triangles *m, uint32_t vertex, int c) {
  const double srgb = (double)(m->colors[vertex] >> 8 * c & 255) / 255;
  return m->linear ? tc_ref_to_linear(srgb) : srgb;
}

/* Moeller and Trumbore (1997). */
static void try_triangle(const tc_ref_triangles *m, uint32_t i, const double from[3], const double along[3],
                         double enter, tc_ref_triangle_hit *hit) {
  double at[3][3], ab[3], ac[3], to[3], p[3], q[3], face[3];
  const uint32_t *corner = m->triangles[i];
  for (int c = 0; c < 3; c++)
    for (int k = 0; k < 3; k++) at[c][k] = (double)m->positions[corner[c]][k];
  for (int k = 0; k < 3; k++) ab[k] = at[1][k] - at[0][k], ac[k] = at[2][k] - at[0][k], to[k] = from[k] - at[0][k];
  cross(along, ac, p), cross(to, ab, q), cross(ab, ac, face);
  const double det = dot(ab, p), u = dot(to, p) / det, v = dot(along, q) / det, t = dot(ac, q) / det;
  if (!(u >= 0 && v >= 0 && u + v <= 1 && t > enter && t < hit->t)) return;
  const double weight[3] = {1 - u - v, u, v};
  hit->t = t, hit->back = dot(face, along) > 0;
  memcpy(hit->normal, face, sizeof face);
  for (int c = 0; c < 3 && m->colors; c++)
    hit->color[c] = weight[0] * channel(m, corner[0], c) + weight[1] * channel(m, corner[1], c) + weight[2] * channel(m, corner[2], c);
  if (!m->normals) return;
  memset(hit->normal, 0, sizeof hit->normal);
  for (int c = 0; c < 3; c++)
    for (int k = 0; k < 3; k++) hit->normal[k] += weight[c] * (double)m->normals[corner[c]][k];
}

bool tc_ref_triangles_hit(const tc_ref_triangles *m, const tc_ref_ray *ray, double after, tc_ref_triangle_hit *hit) {
  uint32_t open[64];
  int n = 0;
  double from[3];
  const double enter = fmax(ray->enter, after + APART);
  for (int k = 0; k < 3; k++) from[k] = ray->lps[k] - m->origin[k];
  hit->t = ray->leave;
  if (m->n_nodes) open[n++] = 0;
  while (n) {
    const node *at = &m->nodes[open[--n]];
    if (!meets(at, from, ray->lps_direction, enter, hit->t)) continue;
    for (uint32_t i = at->first; i < at->first + at->n; i++) try_triangle(m, i, from, ray->lps_direction, enter, hit);
    if (!at->n) open[n++] = at->first, open[n++] = (uint32_t)(at - m->nodes) + 1;
  }
  return hit->t < ray->leave;
}
