/* Builds the clusters of a mesh (clusters.h): cuts along the order of the triangles, and the clusters' arrays. Every pass is split
 * into chunks for any thread; the result depends neither on the number of threads nor on the order of chunks. */
#include "renderer/base/reserve.h"
#include "renderer/mesh/clusters_join.h"
#include "renderer/mesh/clusters_sort.h"
#include "renderer/mesh/measure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define CHUNK 8192 /* triangles of a task, or vertices */
#define MOST_CUTS (CHUNK / (TC_CLUSTER_VERTICES / 3) + 1)
#define LANES TC_CLUSTER_PAD /* numbers that are added up or compared side by side, so that vectors do it */

/* A cluster before its position in the arrays is known. */
typedef struct cut {
  uint32_t first; /* triangle */
  uint8_t n_triangles, n_vertices;
} cut;

typedef struct chunk_sums {
  uint64_t border; /* sum over triangles; 0 if the mesh is closed (measure.h) */
  double volume;  /* six times the enclosed volume of a closed mesh; negative if normals point inwards */
  int n_cuts;
  size_t vertex_room, triangle_room;
  cut cuts[MOST_CUTS];
} chunk_sums;

typedef struct chunk_box {
  float box[2][3]; /* lowest and highest coordinates of the finite vertices */
  bool finite;     /* all are */
} chunk_box;

typedef struct builder {
  const tc_mesh *mesh;
  tc_pool *pool;
  tc_share share;
  const uint32_t (*triangles)[3]; /* [n] in order: the mesh's own or sorted */
  size_t n;
  tc_sorted sorted;
  int n_chunks;
  chunk_sums *chunks;
  chunk_box *boxes;
  uint32_t *numbers; /* [n] corners as numbers within the cluster, 8 bits each */
  tc_clusters *out;
  uint32_t *first_cluster, *first_vertex, *first_triangle; /* [chunk] first of the chunk in each array */
} builder;

static int chunks_of(size_t n) { return (int)((n + CHUNK - 1) / CHUNK); }

static size_t chunk_end(size_t n, int chunk) {
  const size_t end = ((size_t)chunk + 1) * CHUNK;
  return end < n ? end : n;
}

/* ---- bounds of the mesh ---- */

enum { SIDE_BY_SIDE = 12 }; /* coordinates of four vertices */

/* Returns whether all coordinates are finite. */
static bool bound_coordinates(const float *at, size_t n, float lo[3], float hi[3]) {
  float least[SIDE_BY_SIDE], most[SIDE_BY_SIDE], sum[SIDE_BY_SIDE] = {0}, all = 0;
  size_t i = 0;
  for (int l = 0; l < SIDE_BY_SIDE; l++) least[l] = lo[l % 3], most[l] = hi[l % 3];
  for (; i + SIDE_BY_SIDE <= n; i += SIDE_BY_SIDE)
    for (int l = 0; l < SIDE_BY_SIDE; l++) {
      least[l] = lesser(least[l], at[i + (size_t)l]), most[l] = greater(most[l], at[i + (size_t)l]);
      sum[l] += at[i + (size_t)l] * 0.0f;
    }
  for (int l = 0; l < SIDE_BY_SIDE; l++) {
    lo[l % 3] = lesser(lo[l % 3], least[l]), hi[l % 3] = greater(hi[l % 3], most[l]);
    all += sum[l];
  }
  for (; i < n; i++) {
    lo[i % 3] = lesser(lo[i % 3], at[i]), hi[i % 3] = greater(hi[i % 3], at[i]);
    all += at[i] * 0.0f;
  }
  return all == 0;
}

static void bound_chunk(void *context, int chunk, int worker) {
  builder *b = context;
  chunk_box *c = &b->boxes[chunk];
  const size_t first = (size_t)chunk * CHUNK, end = chunk_end(b->mesh->n_vertices, chunk);
  const chunk_box none = {{{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}}, false};
  *c = none;
  c->finite = bound_coordinates(b->mesh->positions[first], 3 * (end - first), c->box[0], c->box[1]);
  if (c->finite) return;
  *c = none;
  for (size_t i = first; i < end; i++) {
    chunk_box with = *c;
    if (bound_coordinates(b->mesh->positions[i], 3, with.box[0], with.box[1])) *c = with;
  }
}

/* Bounds of the mesh. Returns false if halted. */
static bool bound_mesh(builder *b, float box[2][3], bool *finite) {
  const int n = chunks_of(b->mesh->n_vertices);
  float square = 0;
  *finite = true;
  for (int k = 0; k < 3; k++) box[0][k] = INFINITY, box[1][k] = -INFINITY;
  if (!tc_pool_run(b->pool, n, bound_chunk, b)) return false;
  for (int c = 0; c < n; c++) {
    *finite = *finite && b->boxes[c].finite;
    for (int k = 0; k < 3; k++) {
      box[0][k] = lesser(box[0][k], b->boxes[c].box[0][k]);
      box[1][k] = greater(box[1][k], b->boxes[c].box[1][k]);
    }
  }
  for (int k = 0; k < 3 && box[0][0] <= box[1][0]; k++) {
    b->out->centre[k] = 0.5f * (box[0][k] + box[1][k]);
    square += (box[1][k] - box[0][k]) * (box[1][k] - box[0][k]);
  }
  b->out->radius = 0.5f * sqrtf(square) * (1 + 1e-5f);
  return true;
}

/* ---- cuts ---- */

/* Numbers of vertices within a cluster: an open-addressing hash table. Entries with an old stamp are empty. */
#define SLOT_BITS 10 /* so large that collisions are rare */
typedef struct numbering {
  uint32_t stamp, n;
  uint64_t keys[1 << SLOT_BITS]; /* stamp, vertex */
  uint8_t numbers[1 << SLOT_BITS];
} numbering;

static void begin_numbering(numbering *t) { t->stamp++, t->n = 0; }

/* Numbers of a triangle's corners, 8 bits each. Returns false if the cluster is full and the next one must begin. Whether a vertex
 * is new cannot be foreseen, so that no branch depends on it. */
static inline bool add_triangle(numbering *t, const uint32_t v[3], uint32_t *numbers) {
  uint32_t n = t->n, all = 0;
  for (int k = 0; k < 3; k++) {
    const uint64_t key = (uint64_t)t->stamp << 32 | v[k];
    uint32_t slot = v[k] * 0x9e3779b1u >> (32 - SLOT_BITS);
    while ((t->keys[slot] ^ key) - 1 < UINT32_MAX) slot = (slot + 1) % (1 << SLOT_BITS); /* another vertex of this cluster */
    const uint32_t fresh = t->keys[slot] != key, mine = -fresh, number = (n & mine) | (t->numbers[slot] & ~mine);
    t->keys[slot] = key, t->numbers[slot] = (uint8_t)number;
    all |= number << 8 * k;
    n += fresh;
  }
  *numbers = all;
  if (n > TC_CLUSTER_VERTICES) return false;
  t->n = n;
  return true;
}

static void cut_chunk(void *context, int chunk, int worker) {
  builder *b = context;
  chunk_sums *c = &b->chunks[chunk];
  numbering t = {0};
  cut now = {(uint32_t)chunk * CHUNK, 0, 0};
  begin_numbering(&t);
  for (size_t i = (size_t)chunk * CHUNK, end = chunk_end(b->n, chunk); i <= end; i++) {
    const bool last = i == end, full = now.n_triangles == TC_CLUSTER_TRIANGLES;
    if (!last && !full && add_triangle(&t, b->triangles[i], &b->numbers[i])) {
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
    add_triangle(&t, b->triangles[i], &b->numbers[i]);
  }
}

/* ---- clusters ---- */

/* Packs unit vectors; 0 stands for z where there is no direction. */
static void pack_normals(const float x[], const float y[], const float z[], size_t n, uint32_t *restrict out) {
  const float round = 12582912.0f; /* 1.5 * 2^23: the sum's low bits are the rounded number */
  for (size_t i = 0; i < n; i++) {
    const float sum = fabsf(x[i]) + fabsf(y[i]) + fabsf(z[i]), u = x[i] / sum, v = y[i] / sum;
    const float over_u = 1 - fabsf(v), over_v = 1 - fabsf(u), flat_u = fabsf(u), flat_v = fabsf(v);
    const float right = copysignf(z[i] < 0 ? over_u : flat_u, u) * 32767 + round;
    const float down = copysignf(z[i] < 0 ? over_v : flat_v, v) * 32767 + round;
    uint32_t a, b;
    memcpy(&a, &right, sizeof a), memcpy(&b, &down, sizeof b);
    const uint32_t both = (a & 0xffff) | b << 16, none = 0;
    out[i] = (sum > 0) & (sum < INFINITY) ? both : none;
  }
}

/* Lists a cluster's vertices, and has them brought near: a mesh keeps them in another order. */
static void list_vertices(const builder *b, const cut *c, uint32_t of[TC_CLUSTER_VERTICES]) {
  const uint32_t(*v)[3] = b->triangles + c->first, *numbers = b->numbers + c->first;
  for (size_t j = 0; j < c->n_triangles; j++)
    for (int d = 0; d < 3; d++) of[(uint8_t)(numbers[j] >> 8 * d)] = v[j][d];
  for (size_t i = 0; i < c->n_vertices; i++) {
    __builtin_prefetch(b->mesh->positions[of[i]]);
    if (b->mesh->normals) __builtin_prefetch(b->mesh->normals[of[i]]);
  }
}

static void put_triangles(const builder *b, const tc_cluster *k, const cut *c) {
  const size_t n = c->n_triangles, room = tc_cluster_padded(n);
  const uint32_t *numbers = b->numbers + c->first;
  for (size_t d = 0; d < 3; d++) {
    uint8_t *restrict to = b->out->triangles + 3 * (size_t)k->triangle + d * room;
    for (size_t j = 0; j < n; j++) to[j] = (uint8_t)(numbers[j] >> 8 * d);
    memset(to + n, 0, room - n); /* padding triangles have no area */
  }
}

/* Three numbers for each vertex, as arrays of their own; the padding repeats the first vertex. */
static void gather(const float (*from)[3], const uint32_t *of, size_t n, size_t room, float *restrict to) {
  for (size_t i = 0; i < n; i++)
    for (size_t d = 0; d < 3; d++) to[d * room + i] = from[of[i]][d];
  for (size_t d = 0; d < 3; d++)
    for (size_t i = n; i < room; i++) to[d * room + i] = to[d * room];
}

static void put_vertices(const builder *b, const tc_cluster *k, const uint32_t of[TC_CLUSTER_VERTICES]) {
  const size_t room = tc_cluster_padded(k->n_vertices);
  const tc_mesh *m = b->mesh;
  gather((const float(*)[3])m->positions, of, k->n_vertices, room, b->out->positions + 3 * (size_t)k->vertex);
  for (size_t i = 0; i < room && b->out->colors; i++) b->out->colors[k->vertex + i] = m->colors[of[i < k->n_vertices ? i : 0]];
  if (!b->out->normals) return;
  float n[3 * TC_CLUSTER_VERTICES];
  gather((const float(*)[3])m->normals, of, k->n_vertices, room, n);
  pack_normals(n, n + room, n + 2 * room, room, b->out->normals + k->vertex);
}

/* Sphere about the centre of the bounding box: at most a seventh larger than the smallest one for any set of points. */
static void bound_vertices(tc_cluster *k, const float *at) {
  const size_t room = tc_cluster_padded(k->n_vertices);
  float square[TC_CLUSTER_VERTICES] = {0}, most = 0;
  for (size_t d = 0; d < 3; d++) {
    const float *x = at + d * room; /* the padding repeats the first vertex */
    float lo[LANES], hi[LANES];
    memcpy(lo, x, sizeof lo), memcpy(hi, x, sizeof hi);
    for (size_t i = LANES; i < room; i += LANES) {
      for (size_t l = 0; l < LANES; l++) lo[l] = lesser(lo[l], x[i + l]);
      for (size_t l = 0; l < LANES; l++) hi[l] = greater(hi[l], x[i + l]);
    }
    for (size_t l = 1; l < LANES; l++) lo[0] = lesser(lo[0], lo[l]), hi[0] = greater(hi[0], hi[l]);
    k->centre[d] = 0.5f * (lo[0] + hi[0]);
    for (size_t i = 0; i < room; i++) square[i] += (x[i] - k->centre[d]) * (x[i] - k->centre[d]);
  }
  for (size_t i = 0; i < room; i++) most = greater(most, square[i]);
  k->radius = sqrtf(most) * (1 + 1e-5f);
}

/* Normals of a cluster's triangles, of twice the area's length. Returns six times the volume between them and the origin. */
static double face_normals(const tc_cluster *k, const float *at, const uint8_t *corners, float n[3][TC_CLUSTER_TRIANGLES]) {
  const size_t room = tc_cluster_padded(k->n_vertices), row = tc_cluster_padded(k->n_triangles);
  double volume = 0;
  for (size_t i = 0; i < k->n_triangles; i++) {
    const float *a = at + corners[i], *b = at + corners[row + i], *c = at + corners[2 * row + i];
    float u[3], v[3], from[3];
    for (size_t d = 0; d < 3; d++) from[d] = a[d * room], u[d] = b[d * room] - from[d], v[d] = c[d * room] - from[d];
    for (size_t d = 0; d < 3; d++) n[d][i] = u[(d + 1) % 3] * v[(d + 2) % 3] - u[(d + 2) % 3] * v[(d + 1) % 3];
    volume += (double)(from[0] * n[0][i] + from[1] * n[1][i] + from[2] * n[2][i]);
  }
  return volume;
}

/* Makes normals unit; NaN, which stands for any direction, if the area underflows single precision. axis: their mean, unit. */
static void mean_normal(size_t room, float n[3][TC_CLUSTER_TRIANGLES], size_t n_triangles, float axis[3]) {
  float sum[3][LANES] = {{0}};
  for (size_t i = 0; i < room; i++) {
    const float scale = 1 / sqrtf(n[0][i] * n[0][i] + n[1][i] * n[1][i] + n[2][i] * n[2][i]);
    for (size_t d = 0; d < 3; d++) n[d][i] *= scale;
  }
  for (size_t d = 0; d < 3; d++) {
    for (size_t i = n_triangles; i < room; i++) n[d][i] = 0;
    for (size_t i = 0; i < room; i += LANES)
      for (size_t l = 0; l < LANES; l++) sum[d][l] += n[d][i + l];
    axis[d] = 0;
    for (size_t l = 0; l < LANES; l++) axis[d] += sum[d][l];
    for (size_t i = n_triangles; i < room; i++) n[d][i] = n[d][0];
  }
  const float length = sqrtf(axis[0] * axis[0] + axis[1] * axis[1] + axis[2] * axis[2]);
  for (size_t d = 0; d < 3; d++) axis[d] /= greater(length, 1e-30f);
}

/* Returns the volume as above. */
static double bound_normals(tc_cluster *k, const float *at, const uint8_t *corners) {
  const size_t room = tc_cluster_padded(k->n_triangles);
  float n[3][TC_CLUSTER_TRIANGLES], axis[3], least[LANES];
  const double volume = face_normals(k, at, corners, n);
  mean_normal(room, n, k->n_triangles, axis);
  for (size_t l = 0; l < LANES; l++) least[l] = 1;
  for (size_t i = 0; i < room; i += LANES)
    for (size_t l = 0; l < LANES; l++) {
      const float along = n[0][i + l] * axis[0] + n[1][i + l] * axis[1] + n[2][i + l] * axis[2];
      least[l] = lesser(least[l], along == along ? along : -1);
    }
  for (size_t l = 1; l < LANES; l++) least[0] = lesser(least[0], least[l]);
  memcpy(k->axis, axis, sizeof k->axis);
  k->spread = least[0] > 0 ? sqrtf(greater(1 - least[0] * least[0], 0)) + 1e-3f : 2;
  return volume;
}

static uint64_t sum_border(const cut *c, const uint32_t of[TC_CLUSTER_VERTICES], const uint32_t *numbers) {
  tc_mesh_point points[TC_CLUSTER_VERTICES];
  uint64_t sum = 0;
  for (size_t i = 0; i < c->n_vertices; i++) points[i] = tc_mesh_point_of(of[i]);
  for (size_t i = 0; i < c->n_triangles; i++)
    sum += tc_mesh_area_of(points[(uint8_t)numbers[i]], points[(uint8_t)(numbers[i] >> 8)], points[(uint8_t)(numbers[i] >> 16)]);
  return sum;
}

static void fill_chunk(void *context, int chunk, int worker) {
  builder *b = context;
  chunk_sums *sums = &b->chunks[chunk];
  uint32_t cluster = b->first_cluster[chunk], vertex = b->first_vertex[chunk], triangle = b->first_triangle[chunk], of[2][TC_CLUSTER_VERTICES];
  if (sums->n_cuts) list_vertices(b, sums->cuts, of[0]);
  for (int i = 0; i < sums->n_cuts; i++, cluster++) {
    const cut *c = &sums->cuts[i];
    tc_cluster *k = &b->out->clusters[cluster];
    if (i + 1 < sums->n_cuts) list_vertices(b, c + 1, of[(i + 1) & 1]);
    *k = (tc_cluster){.vertex = vertex, .triangle = triangle, .n_vertices = c->n_vertices, .n_triangles = c->n_triangles};
    put_triangles(b, k, c);
    put_vertices(b, k, of[i & 1]);
    const float *at = b->out->positions + 3 * (size_t)vertex;
    bound_vertices(k, at);
    sums->volume += bound_normals(k, at, b->out->triangles + 3 * (size_t)triangle);
    sums->border += sum_border(c, of[i & 1], b->numbers + c->first);
    vertex += (uint32_t)tc_cluster_padded(c->n_vertices);
    triangle += (uint32_t)tc_cluster_padded(c->n_triangles);
  }
}

/* ---- all ---- */

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
    tc_set_error(error, TC_ERROR_LIMIT, NULL, "clusters of a mesh: %zu triangles are too many", b->n);
    return false;
  }
  const size_t over = TC_CLUSTER_PAD; /* kernels read whole vectors and words at the end */
  o->clusters = tc_reserve(o->n, sizeof *o->clusters);
  o->positions = tc_reserve(o->vertex_room + over, 3 * sizeof *o->positions);
  o->normals = b->mesh->normals ? tc_reserve(o->vertex_room + over, sizeof *o->normals) : NULL;
  o->colors = b->mesh->colors ? tc_reserve(o->vertex_room + over, sizeof *o->colors) : NULL;
  o->triangles = tc_reserve(o->triangle_room + over, 3);
  if (!o->clusters || !o->positions || (b->mesh->normals && !o->normals) ||
      (b->mesh->colors && !o->colors) || !o->triangles) return tc_clusters_no_memory(error);
  memset(o->triangles + 3 * o->triangle_room, 0, 3 * over);
  o->bytes = tc_clusters_array_bytes(o);
  return true;
}

/* The triangles in the order in which they are cut. */
static bool order(builder *b, GError **error) {
  const tc_mesh *m = b->mesh;
  float box[2][3];
  bool finite;
  b->boxes = malloc(((size_t)chunks_of(m->n_vertices) + 1) * sizeof *b->boxes);
  if (!b->boxes) return tc_clusters_no_memory(error);
  if (!bound_mesh(b, box, &finite)) return tc_halt_say(tc_pool_halt(b->pool), error);
  b->triangles = (const uint32_t(*)[3])m->triangles, b->n = m->n_triangles;
  if (m->ordered && finite) return true;
  if (!tc_clusters_sort(m, (const float(*)[3])box, b->pool, &b->sorted, error)) return false;
  b->triangles = (const uint32_t(*)[3])b->sorted.triangles, b->n = b->sorted.n;
  return true;
}

static bool build(builder *b, GError **error) {
  if (!order(b, error)) return false;
  tc_share_done(&b->share, 0.1);
  b->out->n_triangles = b->n;
  b->n_chunks = chunks_of(b->n);
  b->chunks = calloc((size_t)b->n_chunks + 1, sizeof *b->chunks);
  b->numbers = tc_reserve(b->n, sizeof *b->numbers);
  b->first_cluster = malloc(3 * ((size_t)b->n_chunks + 1) * sizeof *b->first_cluster);
  if (!b->chunks || !b->numbers || !b->first_cluster) return tc_clusters_no_memory(error);
  b->first_vertex = b->first_cluster + b->n_chunks;
  b->first_triangle = b->first_vertex + b->n_chunks;
  if (!tc_pool_run(b->pool, b->n_chunks, cut_chunk, b)) return tc_halt_say(tc_pool_halt(b->pool), error);
  tc_share_done(&b->share, 0.5);
  if (!allocate(b, error)) return false;
  if (!tc_pool_run(b->pool, b->n_chunks, fill_chunk, b)) return tc_halt_say(tc_pool_halt(b->pool), error);
  uint64_t border = b->sorted.border;
  double volume = 0;
  for (int c = 0; c < b->n_chunks; c++) border += b->chunks[c].border, volume += b->chunks[c].volume;
  b->out->parts[0].closed = border == 0 && volume > 0;
  return true;
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
  free(b.sorted.triangles);
  free(b.boxes);
  free(b.chunks);
  free(b.numbers);
  free(b.first_cluster);
  if (made) return b.out;
  tc_clusters_free(b.out);
  return NULL;
}
