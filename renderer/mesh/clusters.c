/* Builds the clusters of a mesh (clusters.h): Morton keys, radix sort, cuts, and the clusters' arrays. Every pass is split into
 * chunks for any thread; the result depends neither on the number of threads nor on the order of chunks. */
#include "renderer/mesh/clusters_join.h"
#include "renderer/mesh/measure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define CHUNK 8192 /* triangles of a task */
#define SORTED 16  /* chunks of a task of the sort; one thread sums the counts of all tasks */
#define MOST_CUTS (CHUNK / (TC_CLUSTER_VERTICES / 3) + 1)
#define DIGIT_BITS 12
#define DIGITS (1 << DIGIT_BITS)
/* Bits of a key along one axis; a whole key has three times as many, two digits of the sort. Four bits (one digit) would build 7 %
 * faster, but clusters would be rows of cells and frames a quarter to a third slower (7.3 million triangles, AMD EPYC). */
#define AXIS_BITS 8
#define LEFT_OUT ((1u << 3 * AXIS_BITS) - 1) /* key of a degenerate triangle, sorted behind all others */

typedef struct keyed {
  uint32_t key, triangle;
} keyed;

/* A cluster before its position in the arrays is known. */
typedef struct cut {
  uint32_t first; /* index among the sorted triangles */
  uint8_t n_triangles, n_vertices;
} cut;

typedef struct chunk_sums {
  float lo[3], hi[3];
  uint64_t edges; /* sum of edge hashes; 0 if every edge occurs in both directions */
  double volume;  /* six times the enclosed volume of a closed mesh; negative if normals point inwards */
  size_t kept;
  uint32_t digits[DIGITS]; /* one task of the sort: counts, then position of each digit's first item */
  int n_cuts;
  size_t vertex_room, triangle_room;
  cut cuts[MOST_CUTS];
} chunk_sums;

typedef struct builder {
  const tc_mesh *mesh;
  tc_pool *pool;
  tc_share share;
  int n_chunks, shift;
  chunk_sums *chunks;
  keyed *from, *to;
  float lo[3], inverse[3]; /* Morton grid */
  size_t kept;
  tc_clusters *out;
  uint32_t *first_cluster, *first_vertex, *first_triangle; /* [chunk] first of the chunk in each array */
} builder;

static size_t chunk_end(const builder *b, size_t n, int chunk) {
  size_t end = ((size_t)chunk + 1) * CHUNK;
  return end < n ? end : n;
}

/* ---- keys ---- */

static bool finite_triangle(const tc_mesh *m, const uint32_t t[3]) {
  float sum = 0;
  for (int v = 0; v < 3; v++)
    for (int k = 0; k < 3; k++) sum += m->positions[t[v]][k] * 0.0f;
  return sum == 0;
}

/* Six times the volume between a triangle and the origin. */
static double spanned(const tc_mesh *m, const uint32_t t[3]) {
  const float *a = m->positions[t[0]], *b = m->positions[t[1]], *c = m->positions[t[2]];
  double sum = 0;
  for (int k = 0; k < 3; k++) {
    const int u = (k + 1) % 3, v = (k + 2) % 3;
    sum += (double)a[k] * ((double)b[u] * (double)c[v] - (double)b[v] * (double)c[u]);
  }
  return sum;
}

static void measure_chunk(void *context, int chunk, int worker) {
  builder *b = context;
  const tc_mesh *m = b->mesh;
  chunk_sums *c = &b->chunks[chunk];
  for (int k = 0; k < 3; k++) c->lo[k] = INFINITY, c->hi[k] = -INFINITY;
  for (size_t i = (size_t)chunk * CHUNK; i < chunk_end(b, m->n_triangles, chunk); i++) {
    const uint32_t *t = m->triangles[i];
    if (!finite_triangle(m, t)) continue;
    c->volume += spanned(m, t);
    for (int v = 0; v < 3; v++) {
      c->edges += tc_mesh_edge_sum(t[v], t[(v + 1) % 3]);
      for (int k = 0; k < 3; k++) {
        c->lo[k] = lesser(c->lo[k], m->positions[t[v]][k]);
        c->hi[k] = greater(c->hi[k], m->positions[t[v]][k]);
      }
    }
  }
}

static uint32_t spread_bits(uint32_t x) { /* eight bits, two apart */
  x = (x | x << 8) & 0x0300f00fu;
  x = (x | x << 4) & 0x030c30c3u;
  return (x | x << 2) & 0x09249249u;
}

/* Whether two corners coincide. A triangle of zero area with three different corners closes the gap at a T-junction, and is kept. */
static bool is_degenerate(const tc_mesh *m, const uint32_t t[3]) {
  for (int v = 0; v < 3; v++) {
    const float *a = m->positions[t[v]], *b = m->positions[t[(v + 1) % 3]];
    if (a[0] == b[0] && a[1] == b[1] && a[2] == b[2]) return true;
  }
  return false;
}

static uint32_t key_of(const builder *b, const uint32_t t[3]) {
  const tc_mesh *m = b->mesh;
  if (!finite_triangle(m, t) || is_degenerate(m, t)) return LEFT_OUT;
  uint32_t key = 0;
  for (int k = 0; k < 3; k++) {
    float middle = (m->positions[t[0]][k] + m->positions[t[1]][k] + m->positions[t[2]][k]) / 3;
    float at = lesser(greater((middle - b->lo[k]) * b->inverse[k], 0), (1 << AXIS_BITS) - 1);
    key |= spread_bits((uint32_t)at) << k;
  }
  return MIN(key, LEFT_OUT - 1);
}

static void key_chunk(void *context, int chunk, int worker) {
  builder *b = context;
  for (size_t i = (size_t)chunk * CHUNK; i < chunk_end(b, b->mesh->n_triangles, chunk); i++) {
    b->from[i] = (keyed){key_of(b, b->mesh->triangles[i]), (uint32_t)i};
    b->chunks[chunk].kept += b->from[i].key != LEFT_OUT;
  }
}

/* ---- sort ---- */

static size_t task_end(const builder *b, int task) {
  const size_t end = ((size_t)task + 1) * SORTED * CHUNK;
  return MIN(end, b->mesh->n_triangles);
}

static void count_digits(void *context, int task, int worker) {
  builder *b = context;
  uint32_t *digits = b->chunks[task].digits;
  memset(digits, 0, sizeof b->chunks[task].digits);
  for (size_t i = (size_t)task * SORTED * CHUNK, end = task_end(b, task); i < end; i++)
    digits[b->from[i].key >> b->shift & (DIGITS - 1)]++;
}

static void place_by_digit(void *context, int task, int worker) {
  builder *b = context;
  uint32_t *digits = b->chunks[task].digits;
  for (size_t i = (size_t)task * SORTED * CHUNK, end = task_end(b, task); i < end; i++)
    b->to[digits[b->from[i].key >> b->shift & (DIGITS - 1)]++] = b->from[i];
}

static bool sort_keys(builder *b) {
  const int n_tasks = (b->n_chunks + SORTED - 1) / SORTED;
  for (b->shift = 0; b->shift < 3 * AXIS_BITS; b->shift += DIGIT_BITS) {
    if (!tc_pool_run(b->pool, n_tasks, count_digits, b)) return false;
    uint32_t at = 0;
    for (int d = 0; d < DIGITS; d++)
      for (int c = 0; c < n_tasks; c++) {
        uint32_t n = b->chunks[c].digits[d];
        b->chunks[c].digits[d] = at;
        at += n;
      }
    if (!tc_pool_run(b->pool, n_tasks, place_by_digit, b)) return false;
    keyed *other = b->from;
    b->from = b->to, b->to = other;
  }
  return true;
}

/* ---- cuts ---- */

/* Numbers of vertices within a cluster: an open-addressing hash table; entries with an old stamp are empty. */
typedef struct numbering {
  uint32_t stamp, n;
  uint64_t keys[256]; /* stamp, vertex */
  uint8_t numbers[256];
} numbering;

static void begin_numbering(numbering *t) { t->stamp++, t->n = 0; }

/* Numbers of a triangle's corners, 8 bits each. Returns false if the cluster is full and the next one must begin. */
static bool add_triangle(numbering *t, const uint32_t v[3], uint32_t *numbers) {
  uint32_t n = t->n;
  *numbers = 0;
  for (int k = 0; k < 3; k++) {
    const uint64_t key = (uint64_t)t->stamp << 32 | v[k];
    uint32_t slot = v[k] * 0x9e3779b1u >> 24;
    while (t->keys[slot] != key && t->keys[slot] >> 32 == t->stamp) slot = (slot + 1) & 255;
    if (t->keys[slot] != key) t->keys[slot] = key, t->numbers[slot] = (uint8_t)n++;
    *numbers |= (uint32_t)t->numbers[slot] << 8 * k;
  }
  if (n > TC_CLUSTER_VERTICES) return false;
  t->n = n;
  return true;
}

#define AHEAD 24 /* triangles prefetched, since they are read in random order */

static inline void fetch_ahead(const builder *b, size_t i) {
  if (i + AHEAD < b->kept) __builtin_prefetch(b->mesh->triangles[b->from[i + AHEAD].triangle]);
}

/* After the sort, the other half of its memory holds the corners' numbers. */
static void cut_chunk(void *context, int chunk, int worker) {
  builder *b = context;
  chunk_sums *c = &b->chunks[chunk];
  numbering t = {0};
  cut now = {(uint32_t)chunk * CHUNK, 0, 0};
  begin_numbering(&t);
  for (size_t i = (size_t)chunk * CHUNK, end = chunk_end(b, b->kept, chunk); i <= end; i++) {
    fetch_ahead(b, i);
    const bool last = i == end, full = now.n_triangles == TC_CLUSTER_TRIANGLES;
    const uint32_t *v = b->mesh->triangles[b->from[last ? 0 : i].triangle];
    if (!last && !full && add_triangle(&t, v, &b->to[i].key)) {
      now.n_triangles++;
      continue;
    }
    now.n_vertices = (uint8_t)t.n;
    if (now.n_triangles) c->cuts[c->n_cuts++] = now;
    c->vertex_room += tc_cluster_padded(t.n);
    c->triangle_room += tc_cluster_padded(now.n_triangles);
    if (last) return;
    now = (cut){(uint32_t)i, 1, 0};
    begin_numbering(&t);
    add_triangle(&t, v, &b->to[i].key);
  }
}

/* ---- clusters ---- */

static uint32_t octahedral(const float n[3]) {
  float sum = fabsf(n[0]) + fabsf(n[1]) + fabsf(n[2]);
  if (!(sum > 0 && sum < INFINITY)) return 0; /* no direction: use z */
  float x = n[0] / sum, y = n[1] / sum;
  if (n[2] < 0) {
    float u = copysignf(1 - fabsf(y), x);
    y = copysignf(1 - fabsf(x), y), x = u;
  }
  return (uint32_t)(uint16_t)(int16_t)lrintf(x * 32767) | (uint32_t)(uint16_t)(int16_t)lrintf(y * 32767) << 16;
}

static void put_triangles(const builder *b, const tc_cluster *k, const cut *c, uint32_t of[TC_CLUSTER_VERTICES]) {
  const size_t room = tc_cluster_padded(c->n_triangles);
  uint8_t *to = b->out->triangles + 3 * (size_t)k->triangle;
  uint32_t n = 0;
  memset(to, 0, 3 * room); /* padding triangles have no area */
  for (uint32_t j = 0; j < c->n_triangles; j++) {
    fetch_ahead(b, c->first + j);
    const uint32_t *v = b->mesh->triangles[b->from[c->first + j].triangle], numbers = b->to[c->first + j].key;
    for (size_t d = 0; d < 3; d++) {
      const uint8_t number = (uint8_t)(numbers >> 8 * d);
      if (number == n) {
        __builtin_prefetch(b->mesh->positions[v[d]]);
        if (b->out->normals) __builtin_prefetch(b->mesh->normals[v[d]]);
        if (b->out->colors) __builtin_prefetch(&b->mesh->colors[v[d]]);
        of[n++] = v[d];
      }
      to[d * room + j] = number;
    }
  }
}

static void put_vertices(const builder *b, const tc_cluster *k, const uint32_t of[TC_CLUSTER_VERTICES]) {
  const size_t room = tc_cluster_padded(k->n_vertices);
  float *at = b->out->positions + 3 * (size_t)k->vertex;
  for (size_t i = 0; i < room; i++) {
    const uint32_t v = of[i < k->n_vertices ? i : 0];
    for (size_t d = 0; d < 3; d++) at[d * room + i] = b->mesh->positions[v][d];
    if (b->out->normals) b->out->normals[k->vertex + i] = octahedral(b->mesh->normals[v]);
    if (b->out->colors) b->out->colors[k->vertex + i] = b->mesh->colors[v];
  }
}

/* Sphere about the centre of the bounding box: at most a seventh larger than the smallest one for any set of points. */
static void bound_vertices(tc_cluster *k, const float *at) {
  const size_t room = tc_cluster_padded(k->n_vertices);
  float square[TC_CLUSTER_VERTICES] = {0}, most = 0;
  for (size_t d = 0; d < 3; d++) {
    const float *x = at + d * room;
    float lo = x[0], hi = x[0];
    for (size_t i = 1; i < k->n_vertices; i++) lo = lesser(lo, x[i]), hi = greater(hi, x[i]);
    k->centre[d] = 0.5f * (lo + hi);
    for (size_t i = 0; i < room; i++) square[i] += (x[i] - k->centre[d]) * (x[i] - k->centre[d]);
  }
  for (size_t i = 0; i < room; i++) most = greater(most, square[i]);
  k->radius = sqrtf(most) * (1 + 1e-5f);
}

/* Unit normals of a cluster's triangles; NaN, which stands for any direction, if the area underflows single precision. */
static void face_normals(const tc_cluster *k, const float *at, const uint8_t *corners,
                         float n[3][TC_CLUSTER_TRIANGLES]) {
  const size_t room = tc_cluster_padded(k->n_vertices), row = tc_cluster_padded(k->n_triangles);
  for (size_t i = 0; i < k->n_triangles; i++) {
    const uint8_t a = corners[i], b = corners[row + i], c = corners[2 * row + i];
    float u[3], v[3];
    for (size_t d = 0; d < 3; d++) u[d] = at[d * room + b] - at[d * room + a], v[d] = at[d * room + c] - at[d * room + a];
    for (size_t d = 0; d < 3; d++) n[d][i] = u[(d + 1) % 3] * v[(d + 2) % 3] - u[(d + 2) % 3] * v[(d + 1) % 3];
  }
  for (size_t i = 0; i < k->n_triangles; i++) {
    const float scale = 1 / sqrtf(n[0][i] * n[0][i] + n[1][i] * n[1][i] + n[2][i] * n[2][i]);
    for (size_t d = 0; d < 3; d++) n[d][i] *= scale;
  }
}

static void bound_normals(tc_cluster *k, const float *at, const uint8_t *corners) {
  float n[3][TC_CLUSTER_TRIANGLES], axis[3] = {0}, least = 1;
  face_normals(k, at, corners, n);
  for (size_t d = 0; d < 3; d++)
    for (size_t i = 0; i < k->n_triangles; i++) axis[d] += n[d][i];
  const float length = sqrtf(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
  for (size_t d = 0; d < 3; d++) k->axis[d] = axis[d] /= greater(length, 1e-30f);
  for (size_t i = 0; i < k->n_triangles; i++) {
    const float along = n[0][i] * axis[0] + n[1][i] * axis[1] + n[2][i] * axis[2];
    if (!(along >= least)) least = along == along ? along : -1;
  }
  k->spread = least > 0 ? sqrtf(greater(1 - least * least, 0)) + 1e-3f : 2;
}

static void fill_chunk(void *context, int chunk, int worker) {
  builder *b = context;
  uint32_t cluster = b->first_cluster[chunk], vertex = b->first_vertex[chunk], triangle = b->first_triangle[chunk];
  for (int i = 0; i < b->chunks[chunk].n_cuts; i++, cluster++) {
    const cut *c = &b->chunks[chunk].cuts[i];
    tc_cluster *k = &b->out->clusters[cluster];
    uint32_t of[TC_CLUSTER_VERTICES];
    *k = (tc_cluster){.vertex = vertex, .triangle = triangle, .n_vertices = c->n_vertices, .n_triangles = c->n_triangles};
    put_triangles(b, k, c, of);
    put_vertices(b, k, of);
    const float *at = b->out->positions + 3 * (size_t)vertex;
    bound_vertices(k, at);
    bound_normals(k, at, b->out->triangles + 3 * (size_t)triangle);
    vertex += (uint32_t)tc_cluster_padded(c->n_vertices);
    triangle += (uint32_t)tc_cluster_padded(c->n_triangles);
  }
}

/* ---- all ---- */

static void set_grid(builder *b) {
  float hi[3], square = 0;
  uint64_t edges = 0;
  double volume = 0;
  for (int k = 0; k < 3; k++) b->lo[k] = INFINITY, hi[k] = -INFINITY;
  for (int c = 0; c < b->n_chunks; c++) {
    edges += b->chunks[c].edges;
    volume += b->chunks[c].volume;
    for (int k = 0; k < 3; k++) {
      b->lo[k] = lesser(b->lo[k], b->chunks[c].lo[k]);
      hi[k] = greater(hi[k], b->chunks[c].hi[k]);
    }
  }
  float longest = greater(hi[0] - b->lo[0], greater(hi[1] - b->lo[1], hi[2] - b->lo[2]));
  for (int k = 0; k < 3; k++) {
    b->inverse[k] = longest > 0 ? (1 << AXIS_BITS) / longest : 0;
    b->out->centre[k] = longest >= 0 ? 0.5f * (b->lo[k] + hi[k]) : 0;
    square += longest >= 0 ? (hi[k] - b->lo[k]) * (hi[k] - b->lo[k]) : 0;
  }
  b->out->radius = 0.5f * sqrtf(square) * (1 + 1e-5f);
  b->out->parts[0].closed = edges == 0 && volume > 0;
}

static bool allocate(builder *b, GError **error) {
  tc_clusters *o = b->out;
  for (int c = 0; c < b->n_chunks; c++) {
    b->first_cluster[c] = (uint32_t)o->n;
    b->first_vertex[c] = (uint32_t)o->vertex_room;
    b->first_triangle[c] = (uint32_t)o->triangle_room;
    o->n += (size_t)b->chunks[c].n_cuts;
    o->vertex_room += b->chunks[c].vertex_room;
    o->triangle_room += b->chunks[c].triangle_room;
  }
  if (o->vertex_room > UINT32_MAX || o->triangle_room > UINT32_MAX) {
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "clusters of a mesh: %zu triangles are too many", b->kept);
    return false;
  }
  const size_t over = TC_CLUSTER_PAD; /* kernels read whole vectors and words at the end */
  o->clusters = tc_mesh_reserve(o->n, sizeof *o->clusters);
  o->positions = tc_mesh_reserve(o->vertex_room + over, 3 * sizeof *o->positions);
  o->normals = b->mesh->normals ? tc_mesh_reserve(o->vertex_room + over, sizeof *o->normals) : NULL;
  o->colors = b->mesh->colors ? tc_mesh_reserve(o->vertex_room + over, sizeof *o->colors) : NULL;
  o->triangles = tc_mesh_reserve(o->triangle_room + over, 3);
  if (!o->clusters || !o->positions || (b->mesh->normals && !o->normals) ||
      (b->mesh->colors && !o->colors) || !o->triangles) return tc_clusters_no_memory(error);
  memset(o->triangles + 3 * o->triangle_room, 0, 3 * over);
  o->bytes = tc_clusters_array_bytes(o);
  return true;
}

static bool build(builder *b, GError **error) {
  const tc_mesh *m = b->mesh;
  b->n_chunks = (int)((m->n_triangles + CHUNK - 1) / CHUNK);
  b->chunks = calloc((size_t)b->n_chunks + 1, sizeof *b->chunks);
  b->from = tc_mesh_reserve(m->n_triangles, sizeof *b->from);
  b->to = tc_mesh_reserve(m->n_triangles, sizeof *b->to);
  b->first_cluster = malloc(3 * ((size_t)b->n_chunks + 1) * sizeof *b->first_cluster);
  if (!b->chunks || !b->from || !b->to || !b->first_cluster) return tc_clusters_no_memory(error);
  b->first_vertex = b->first_cluster + b->n_chunks;
  b->first_triangle = b->first_vertex + b->n_chunks;
  if (!tc_pool_run(b->pool, b->n_chunks, measure_chunk, b)) return tc_halt_say(tc_pool_halt(b->pool), error);
  tc_share_done(&b->share, 0.15);
  set_grid(b);
  if (!tc_pool_run(b->pool, b->n_chunks, key_chunk, b) || !sort_keys(b)) return tc_halt_say(tc_pool_halt(b->pool), error);
  tc_share_done(&b->share, 0.4);
  for (int c = 0; c < b->n_chunks; c++) b->kept += b->chunks[c].kept;
  b->n_chunks = (int)((b->kept + CHUNK - 1) / CHUNK);
  b->out->n_triangles = b->kept;
  if (!tc_pool_run(b->pool, b->n_chunks, cut_chunk, b)) return tc_halt_say(tc_pool_halt(b->pool), error);
  tc_share_done(&b->share, 0.6);
  return allocate(b, error) &&
         (tc_pool_run(b->pool, b->n_chunks, fill_chunk, b) || tc_halt_say(tc_pool_halt(b->pool), error));
}

tc_clusters *tc_clusters_make(const tc_mesh *mesh, tc_pool *pool, const tc_share *share, GError **error) {
  builder b = {.mesh = mesh, .pool = pool, .share = share ? *share : (tc_share){0}, .out = calloc(1, sizeof *b.out)};
  if (b.out) b.out->parts = calloc(1, sizeof *b.out->parts);
  if (!b.out || !b.out->parts) {
    tc_clusters_free(b.out);
    tc_clusters_no_memory(error);
    return NULL;
  }
  b.out->serial = tc_clusters_next_serial();
  memcpy(b.out->origin, mesh->origin, sizeof mesh->origin);
  const bool made = build(&b, error);
  b.out->n_parts = 1;
  b.out->parts[0].n = b.out->n;
  b.out->parts[0].colored = mesh->colors != NULL;
  free(b.chunks);
  free(b.from);
  free(b.to);
  free(b.first_cluster);
  if (made) return b.out;
  tc_clusters_free(b.out);
  return NULL;
}
