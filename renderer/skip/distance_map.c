#include "renderer/skip/distance_map.h"

#include <stdlib.h>
#include <string.h>

#include "renderer/base/clock.h"
#include "renderer/skip/empty_ranges.h"

#define FAR 254 /* a u8 distance that leaves room for +1 */

typedef struct map_job {
  const tc_minmax *minmax;
  const tc_empty_ranges *ranges;
  const tc_distance_map *before; /* NULL, or of the same blocks */
  uint8_t *distance;
  uint32_t *empty; /* [layers] */
  bool *changed;   /* [layers] */
} map_job;

static size_t layer_size(const int blocks[3]) { return (size_t)blocks[0] * (size_t)blocks[1]; }

/* Sets distance 0 (occupied) or FAR (empty) in one layer of blocks. */
static void mark_layer(void *context, int z, int worker) {
  (void)worker;
  map_job *job = context;
  uint8_t sets[512];
  size_t count = layer_size(job->minmax->blocks), end = ((size_t)z + 1) * count;
  bool changed = false;
  for (size_t i = (size_t)z * count; i < end;) {
    int n = end - i < sizeof sets / 2 ? (int)(end - i) : (int)sizeof sets / 2;
    tc_empty_ranges_read(job->ranges, job->minmax->pairs, 2 * i, 2 * n, sets);
    for (int k = 0; k < n; k++, i++) {
      bool empty = sets[2 * k] & sets[2 * k + 1];
      job->distance[i] = empty ? FAR : 0;
      job->empty[z] += empty;
      if (job->before) changed |= empty != (job->before->distance[i] != 0);
    }
  }
  job->changed[z] = changed;
}

/* The distance map by two sweeps (chamfer), each over half of the 26 neighbours, which is exact for the Chebyshev
 * metric. sweep() covers layers from..to and starts from the layer before `from` in its direction. The four
 * neighbouring rows are first reduced to one minimum (joined: [blocks x + 2]) and widened sideways, so that everything
 * but the dependency within the row vectorises. */
static void join_row(const uint8_t *restrict other, uint8_t *restrict near, int nx) {
  for (int x = 0; x < nx; x++) near[x] = other[x] < near[x] ? other[x] : near[x];
}

static void lower_row(const uint8_t *restrict joined, uint8_t *restrict row, int nx) {
  for (int x = 0; x < nx; x++) {
    uint8_t d = joined[x] < joined[x + 1] ? joined[x] : joined[x + 1];
    d = d < joined[x + 2] ? d : joined[x + 2];
    d = (uint8_t)(d + 1);
    row[x] = d < row[x] ? d : row[x];
  }
}

static void follow_row(uint8_t *p, int nx, int dir) {
  unsigned least = *p;
  for (int x = 1; x < nx; x++) {
    p += dir;
    unsigned next = least + 1, here = *p;
    least = here < next ? here : next;
    *p = (uint8_t)least;
  }
}

static bool sweep(tc_distance_map *map, int from, int to, int dir, uint8_t *joined, const tc_halt *halt) {
  uint8_t *distance = map->distance;
  const int nx = map->blocks[0], ny = map->blocks[1], nz = map->blocks[2];
  for (int z = dir > 0 ? from : to; z >= from && z <= to; z += dir) {
    if (tc_halt_within(halt)) return false;
    for (int iy = 0; iy < ny; iy++) {
      int y = dir > 0 ? iy : ny - 1 - iy;
      uint8_t *row = distance + ((size_t)z * (size_t)ny + (size_t)y) * (size_t)nx;
      memset(joined, FAR, (size_t)nx + 2);
      for (int k = 0; k < 4; k++) { /* the previous row of this layer, then three rows of the previous layer */
        int yy = k ? y + k - 2 : y - dir, zz = k ? z - dir : z;
        if (yy < 0 || yy >= ny || zz < 0 || zz >= nz) continue;
        join_row(distance + ((size_t)zz * (size_t)ny + (size_t)yy) * (size_t)nx, joined + 1, nx);
      }
      lower_row(joined, row, nx);
      follow_row(dir > 0 ? row : row + nx - 1, nx, dir);
    }
  }
  return true;
}

/* The layers *from..*to whose distances may differ from the earlier map's. A block's distance can change only if a
 * block within that distance became occupied or empty: if it shrinks, the nearest occupied block is new; if it
 * grows, the nearest one is gone. False: nothing changed. */
static bool find_affected(const map_job *job, int *from, int *to) {
  int layers = job->minmax->blocks[2], first = layers, last = -1;
  *from = 0, *to = layers - 1;
  if (!job->before) return true;
  for (int z = 0; z < layers; z++)
    if (job->changed[z]) {
      if (first == layers) first = z;
      last = z;
    }
  const uint8_t *farthest = job->before->farthest;
  *from = first, *to = last;
  for (int z = first - 1; z >= 0; z--)
    if (farthest[z] == FAR || farthest[z] >= first - z) *from = z;
  for (int z = last + 1; z < layers; z++)
    if (farthest[z] == FAR || farthest[z] >= z - last) *to = z;
  return last >= 0;
}

static bool fill_distances(const map_job *job, tc_distance_map *map, uint8_t *joined, const tc_halt *halt) {
  const int *n = map->blocks;
  size_t layer = layer_size(n);
  int from, to;
  bool some = find_affected(job, &from, &to);
  for (int z = 0; z < n[2]; z++) {
    if (some && z >= from && z <= to) continue;
    if (tc_halt_within(halt)) return false;
    memcpy(map->distance + (size_t)z * layer, job->before->distance + (size_t)z * layer, layer);
  }
  map->swept = some && map->empty_share > 0 ? to - from + 1 : 0;
  for (int dir = 1; map->swept && dir >= -1; dir -= 2)
    if (!sweep(map, from, to, dir, joined, halt)) return false;
  for (int z = 0; z < n[2]; z++) {
    const uint8_t *d = map->distance + (size_t)z * layer;
    uint8_t most = 0;
    if (tc_halt_within(halt)) return false;
    for (size_t i = 0; i < layer; i++) most = d[i] > most ? d[i] : most;
    map->farthest[z] = most;
  }
  return true;
}

tc_distance_map *tc_distance_map_build(const tc_minmax *m, const tc_support *support, const tc_distance_map *before, tc_pool *pool,
                       GError **error) {
  double start = tc_now_ms();
  size_t layers = (size_t)m->blocks[2], count = layer_size(m->blocks) * layers;
  tc_distance_map *map = calloc(1, sizeof *map);
  map_job job = {.minmax = m, .before = before, .distance = calloc(count + 8 + layers, 1),
                  .empty = calloc(layers, sizeof *job.empty), .changed = calloc(layers, sizeof *job.changed)};
  uint8_t *joined = malloc((size_t)m->blocks[0] + 2);
  tc_empty_ranges ranges = {0};
  bool ok = map && job.distance && job.empty && job.changed && joined;
  if (!ok) tc_set_error(error, TC_ERROR_MEMORY, NULL, "distance map: out of memory");
  ok = ok && tc_empty_ranges_init(&ranges, support, m->type, error);
  if (ok) {
    job.ranges = &ranges;
    ok = tc_pool_run(pool, m->blocks[2], mark_layer, &job);
    size_t empty = 0;
    for (size_t z = 0; z < layers; z++) empty += job.empty[z];
    *map = (tc_distance_map){.block = m->block, .reach = m->reach, .blocks = {m->blocks[0], m->blocks[1], m->blocks[2]},
                      .distance = job.distance, .farthest = job.distance + count + 8,
                      .empty_share = (double)empty / (double)count, .support = support->serial,
                      .bytes = count + 8 + layers};
    ok = ok && fill_distances(&job, map, joined, tc_pool_halt(pool));
    if (!ok) tc_halt_say(tc_pool_halt(pool), error);
    map->build_ms = tc_now_ms() - start;
  }
  if (!ok) {
    free(job.distance);
    free(map);
    map = NULL;
  }
  tc_empty_ranges_finish(&ranges);
  free(job.empty);
  free(job.changed);
  free(joined);
  return map;
}

void tc_distance_map_free(tc_distance_map *map) {
  if (!map) return;
  free(map->distance);
  free(map);
}
