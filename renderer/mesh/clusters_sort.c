/* Orders the triangles of a mesh for clusters: Morton keys of their middles and a radix sort. */
#include "renderer/mesh/clusters_sort.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/base/reserve.h"
#include "renderer/mesh/clusters_join.h"
#include "renderer/mesh/measure.h"

#define CHUNK (1 << 17) /* triangles of a task; one thread sums the counts of all tasks */
#define DIGIT_BITS 12
#define DIGITS (1 << DIGIT_BITS)
/* Bits of a key along one axis; a whole key has three times as many, two digits of the sort. Four bits (one digit) would build 7 %
 * faster, but clusters would be rows of cells and frames a quarter to a third slower (7.3 million triangles, AMD EPYC). */
#define AXIS_BITS 8
#define LEFT_OUT ((1u << 3 * AXIS_BITS) - 1) /* key of a degenerate triangle, sorted behind all others */

typedef struct keyed {
  uint32_t key, triangle;
} keyed;

typedef struct sums {
  uint64_t border;
  size_t kept;
  uint32_t digits[DIGITS]; /* counts, then position of each digit's first item */
} sums;

typedef struct sorting {
  const tc_mesh *mesh;
  tc_pool *pool;
  int n_chunks, shift;
  sums *chunks;
  keyed *from, *to;
  float low[3], inverse[3]; /* Morton grid */
  uint32_t (*out)[3];
  size_t kept;
} sorting;

static size_t chunk_end(size_t n, int chunk) {
  const size_t end = ((size_t)chunk + 1) * CHUNK;
  return end < n ? end : n;
}

/* ---- keys ---- */

static bool finite_triangle(const tc_mesh *m, const uint32_t t[3]) {
  float sum = 0;
  for (int v = 0; v < 3; v++)
    for (int k = 0; k < 3; k++) sum += m->positions[t[v]][k] * 0.0f;
  return sum == 0;
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

static uint32_t key_of(const sorting *s, const uint32_t t[3], uint64_t *border) {
  const tc_mesh *m = s->mesh;
  if (!finite_triangle(m, t)) return LEFT_OUT;
  if (is_degenerate(m, t)) {
    *border += tc_mesh_triangle_sum(t);
    return LEFT_OUT;
  }
  uint32_t key = 0;
  for (int k = 0; k < 3; k++) {
    float middle = (m->positions[t[0]][k] + m->positions[t[1]][k] + m->positions[t[2]][k]) / 3;
    float at = lesser(greater((middle - s->low[k]) * s->inverse[k], 0), (1 << AXIS_BITS) - 1);
    key |= spread_bits((uint32_t)at) << k;
  }
  return MIN(key, LEFT_OUT - 1);
}

static void key_chunk(void *context, int chunk, int worker) {
  sorting *s = context;
  sums *c = &s->chunks[chunk];
  for (size_t i = (size_t)chunk * CHUNK, end = chunk_end(s->mesh->n_triangles, chunk); i < end; i++) {
    s->from[i] = (keyed){key_of(s, s->mesh->triangles[i], &c->border), (uint32_t)i};
    c->kept += s->from[i].key != LEFT_OUT;
  }
}

/* ---- sort ---- */

static void count_digits(void *context, int chunk, int worker) {
  sorting *s = context;
  uint32_t *digits = s->chunks[chunk].digits;
  memset(digits, 0, sizeof s->chunks[chunk].digits);
  for (size_t i = (size_t)chunk * CHUNK, end = chunk_end(s->mesh->n_triangles, chunk); i < end; i++)
    digits[s->from[i].key >> s->shift & (DIGITS - 1)]++;
}

static void place_by_digit(void *context, int chunk, int worker) {
  sorting *s = context;
  uint32_t *digits = s->chunks[chunk].digits;
  for (size_t i = (size_t)chunk * CHUNK, end = chunk_end(s->mesh->n_triangles, chunk); i < end; i++)
    s->to[digits[s->from[i].key >> s->shift & (DIGITS - 1)]++] = s->from[i];
}

static bool sort_keys(sorting *s) {
  for (s->shift = 0; s->shift < 3 * AXIS_BITS; s->shift += DIGIT_BITS) {
    if (!tc_pool_run(s->pool, s->n_chunks, count_digits, s)) return false;
    uint32_t at = 0;
    for (int d = 0; d < DIGITS; d++)
      for (int c = 0; c < s->n_chunks; c++) {
        uint32_t n = s->chunks[c].digits[d];
        s->chunks[c].digits[d] = at;
        at += n;
      }
    if (!tc_pool_run(s->pool, s->n_chunks, place_by_digit, s)) return false;
    keyed *other = s->from;
    s->from = s->to, s->to = other;
  }
  return true;
}

#define AHEAD 24 /* triangles prefetched, since they are read in random order */

static void copy_chunk(void *context, int chunk, int worker) {
  sorting *s = context;
  for (size_t i = (size_t)chunk * CHUNK, end = chunk_end(s->kept, chunk); i < end; i++) {
    if (i + AHEAD < end) __builtin_prefetch(s->mesh->triangles[s->from[i + AHEAD].triangle]);
    memcpy(s->out[i], s->mesh->triangles[s->from[i].triangle], sizeof *s->out);
  }
}

/* ---- all ---- */

static bool sort(sorting *s, GError **error) {
  const size_t n = s->mesh->n_triangles;
  s->n_chunks = (int)((n + CHUNK - 1) / CHUNK);
  s->chunks = calloc((size_t)s->n_chunks + 1, sizeof *s->chunks);
  s->from = tc_reserve(n, sizeof *s->from);
  s->to = tc_reserve(n, sizeof *s->to);
  s->out = tc_reserve(n, sizeof *s->out);
  if (!s->chunks || !s->from || !s->to || !s->out) return tc_clusters_no_memory(error);
  if (!tc_pool_run(s->pool, s->n_chunks, key_chunk, s) || !sort_keys(s)) return tc_halt_say(tc_pool_halt(s->pool), error);
  for (int c = 0; c < s->n_chunks; c++) s->kept += s->chunks[c].kept;
  return tc_pool_run(s->pool, (int)((s->kept + CHUNK - 1) / CHUNK), copy_chunk, s) || tc_halt_say(tc_pool_halt(s->pool), error);
}

bool tc_clusters_sort(const tc_mesh *mesh, const float box[2][3], tc_pool *pool, tc_sorted *sorted, GError **error) {
  sorting s = {.mesh = mesh, .pool = pool};
  float longest = 0;
  for (int k = 0; k < 3; k++) longest = greater(longest, box[1][k] - box[0][k]);
  for (int k = 0; k < 3; k++) {
    s.low[k] = box[0][k];
    s.inverse[k] = longest > 0 ? (1 << AXIS_BITS) / longest : 0;
  }
  const bool good = sort(&s, error);
  *sorted = (tc_sorted){s.out, s.kept, 0};
  for (int c = 0; good && c < s.n_chunks; c++) sorted->border += s.chunks[c].border;
  free(s.chunks);
  free(s.from);
  free(s.to);
  return good;
}
