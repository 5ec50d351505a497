/* Rays against a mesh: triangles in Morton order of their middles, halved again and again, with a box around each half.
 */
#include <assert.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "renderer/reference/internal.h"
#include "renderer/reference/reference.h"

#define LEAF 4
#define TOP 6            /* levels of the tree above the parts that are built in parallel */
#define PORTION 32768    /* triangles that are sorted at once: some milliseconds */
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
  node *nodes; /* [n_triangles], with gaps */
  uint32_t n_triangles;
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
  if (p->code != q->code) return p->code < q->code ? -1 : 1;
  return (p->triangle > q->triangle) - (p->triangle < q->triangle);
}

typedef struct making {
  const tc_reference_mesh *of;
  tc_ref_triangles *to;
  const atomic_bool *cancel;
  pthread_mutex_t lock; /* guards low and high */
  double low[3], high[3];
  placed *from, *order; /* [n_triangles], in the memory of the nodes, which are built once the triangles are sorted */
  size_t run;           /* triangles of a sorted part of `from` */
} making;

static_assert(sizeof(node) == 2 * sizeof(placed), "the nodes' memory holds two orders");

static size_t end_of(const making *m, size_t at) { return MIN(at, m->of->n_triangles); }

static void copy(void *to, const void *from, size_t size, size_t first, size_t end) {
  if (from) memcpy((char *)to + first * size, (const char *)from + first * size, (end - first) * size);
}

/* Vertices, and what box they fill. */
static void copy_portion(void *context, int i) {
  making *m = context;
  const tc_reference_mesh *of = m->of;
  const size_t first = (size_t)i * PORTION, end = MIN(first + PORTION, of->n_vertices);
  double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
  copy(m->to->positions, of->positions, sizeof *of->positions, first, end);
  copy(m->to->normals, of->normals, sizeof *of->normals, first, end);
  copy(m->to->colors, of->colors, sizeof *of->colors, first, end);
  for (size_t v = first; v < end; v++)
    for (int k = 0; k < 3; k++) low[k] = fmin(low[k], (double)of->positions[v][k]), high[k] = fmax(high[k], (double)of->positions[v][k]);
  pthread_mutex_lock(&m->lock);
  for (int k = 0; k < 3; k++) m->low[k] = fmin(m->low[k], low[k]), m->high[k] = fmax(m->high[k], high[k]);
  pthread_mutex_unlock(&m->lock);
}

static void sort_portion(void *context, int i) {
  making *m = context;
  const tc_reference_mesh *of = m->of;
  const size_t first = (size_t)i * PORTION, end = end_of(m, first + PORTION);
  double wide = 0;
  for (int k = 0; k < 3; k++) wide = fmax(wide, m->high[k] - m->low[k]);
  for (size_t t = first; t < end; t++) {
    m->order[t] = (placed){0, (uint32_t)t};
    for (int k = 0; k < 3; k++) {
      double middle = 0;
      for (int c = 0; c < 3; c++) middle += (double)of->positions[of->triangles[t][c]][k] / 3;
      m->order[t].code |= spread((uint64_t)(fmax((middle - m->low[k]) / wide, 0) * 0x1fffff)) << k;
    }
  }
  qsort(m->order + first, end - first, sizeof *m->order, by_code);
}

static void merge_two(void *context, int i) {
  const making *m = context;
  size_t to = 2 * (size_t)i * m->run, a = to, b = end_of(m, to + m->run);
  const size_t middle = b, end = end_of(m, to + 2 * m->run);
  for (; to < end && (to % PORTION || !tc_ref_is_set(m->cancel)); to++)
    m->order[to] = b == end || (a < middle && by_code(&m->from[a], &m->from[b]) < 0) ? m->from[a++] : m->from[b++];
}

static void fetch_portion(void *context, int i) {
  const making *m = context;
  const size_t first = (size_t)i * PORTION, end = end_of(m, first + PORTION);
  for (size_t t = first; t < end; t++) memcpy(m->to->triangles[t], m->of->triangles[m->order[t].triangle], sizeof *m->to->triangles);
}

static bool each(making *m, size_t count, void (*task)(void *context, int index)) {
  return tc_ref_parallel(&(tc_ref_loop){(int)count, m->cancel, task, m}, 0);
}

static size_t portions_of(size_t n) { return (n + PORTION - 1) / PORTION; }

static bool sort_triangles(making *m) {
  const size_t n = m->of->n_triangles;
  bool going = each(m, portions_of(n), sort_portion);
  for (m->run = PORTION; m->run < n && going; m->run *= 2) {
    placed *const sorted = m->order;
    m->order = m->from, m->from = sorted;
    going = each(m, (n + 2 * m->run - 1) / (2 * m->run), merge_two);
  }
  return going && each(m, portions_of(n), fetch_portion);
}

/* Builds the tree of triangles [first, end), of which there is one in all, or more than one, at nodes[at] and behind: n triangles
 * have no more than n - 1 nodes, or 1. built: levels down to parts that have been built; below 0: none has. */
static void build(tc_ref_triangles *m, uint32_t at, uint32_t first, uint32_t end, int built) {
  const uint32_t middle = first + (end - first) / 2;
  node own = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, first, end - first};
  if (built == 0) return;
  if (own.n > LEAF) {
    const uint32_t children[2] = {at + 1, at + middle - first};
    build(m, children[0], first, middle, built - 1), build(m, children[1], middle, end, built - 1);
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
}

/* One of the parts TOP levels down; bits of its number are the way there. */
static void build_part(void *context, int part) {
  const making *m = context;
  uint32_t at = 0, first = 0, end = m->to->n_triangles;
  for (int level = 0; level < TOP; level++) {
    const uint32_t middle = first + (end - first) / 2;
    at += part >> level & 1 ? middle - first : 1;
    if (part >> level & 1) first = middle; else end = middle;
  }
  build(m->to, at, first, end, -1);
}

static bool build_all(making *m) {
  const bool parts = m->to->n_triangles > LEAF << (TOP + 1); /* so many that each has several */
  if (parts && !each(m, 1 << TOP, build_part)) return false;
  if (m->to->n_triangles) build(m->to, 0, 0, m->to->n_triangles, parts ? TOP : -1);
  return true;
}

/* Huge pages, because a quarter of a gigabyte in small ones takes 20 ms to give back. */
static void *reserve(size_t n, size_t size) {
  const size_t page = (size_t)2 << 20, bytes = (n + 1) * size;
  void *p = bytes < page ? malloc(bytes) : aligned_alloc(page, (bytes + page - 1) & ~(page - 1));
  if (p && bytes >= page) madvise(p, bytes & ~(page - 1), MADV_HUGEPAGE); /* failure only costs time */
  return p;
}

static bool reserve_all(tc_ref_triangles *m, const tc_reference_mesh *of) {
  m->positions = reserve(of->n_vertices, sizeof *m->positions);
  m->normals = of->normals ? reserve(of->n_vertices, sizeof *m->normals) : NULL;
  m->colors = of->colors ? reserve(of->n_vertices, sizeof *m->colors) : NULL;
  m->triangles = reserve(of->n_triangles, sizeof *m->triangles);
  m->nodes = reserve(of->n_triangles, sizeof *m->nodes);
  return m->positions && (m->normals || !of->normals) && (m->colors || !of->colors) && m->triangles && m->nodes;
}

tc_ref_triangles *tc_ref_triangles_new(const tc_reference_mesh *of, bool linear, const atomic_bool *cancel) {
  tc_ref_triangles *m = g_new0(tc_ref_triangles, 1);
  memcpy(m->origin, of->origin, sizeof m->origin);
  m->linear = linear, m->n_triangles = (uint32_t)of->n_triangles;
  making making = {.of = of, .to = m, .cancel = cancel, .lock = PTHREAD_MUTEX_INITIALIZER,
                   .low = {INFINITY, INFINITY, INFINITY}, .high = {-INFINITY, -INFINITY, -INFINITY}};
  bool good = reserve_all(m, of);
  if (good) making.order = (placed *)(void *)m->nodes, making.from = making.order + of->n_triangles;
  good = good && each(&making, portions_of(of->n_vertices), copy_portion) && sort_triangles(&making) && build_all(&making);
  pthread_mutex_destroy(&making.lock);
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
  if (m->n_triangles) open[n++] = 0;
  while (n) {
    const node *at = &m->nodes[open[--n]];
    if (!meets(at, from, ray->lps_direction, enter, hit->t)) continue;
    for (uint32_t i = at->first; i < at->first + at->n; i++) try_triangle(m, i, from, ray->lps_direction, enter, hit);
    if (!at->n) open[n++] = at->first, open[n++] = (uint32_t)(at - m->nodes) + 1;
  }
  return hit->t < ray->leave;
}
