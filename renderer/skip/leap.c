#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/skip/skip.h"
#include "renderer/clock.h"

#define FAR 254 /* a u8 distance with room for +1 */

int tc_skip_block(int block) {
  if (block <= 0) return TC_SKIP_BLOCK;
  return block < 2 ? 2 : block > 128 ? 128 : block;
}

int tc_skip_reach(tc_filter filter) { return filter == TC_FILTER_CUBIC; }

bool tc_skip_possible(const tc_transfer_function *tf, double value_min, double value_max) {
  const tc_knot *p = tf->points;
  size_t last = tf->count - 1;
  if (p[0].amount <= 0 && value_min < p[0].value) return true;
  if (p[last].amount <= 0 && value_max > p[last].value) return true;
  for (size_t i = 0; i < last; i++)
    if (p[i].amount <= 0 && p[i + 1].amount <= 0 && p[i + 1].value > value_min && p[i].value < value_max) return true;
  return false;
}

/* A bilinear lookup at nodes (a, b) reads entries that span nodes floor(min) to floor(max) + 2 (classify.h), and no other
 * classification reads more; a node more on each side covers the rounding of the kernels' single precision. */
static bool is_empty(const tc_support *s, double scale, double lo, double hi) {
  if (!s->used) return hi < s->lo || lo > s->hi;
  int first = (int)floor((lo - s->lo) * scale) - 1, last = (int)floor((hi - s->lo) * scale) + 3;
  if (first < 0) first = 0;
  if (last > s->n + 2) last = s->n + 2;
  return s->used[last] == s->used[first];
}

static uint8_t least(const uint8_t *row, int x, int nx) {
  uint8_t d = row[x];
  if (x > 0 && row[x - 1] < d) d = row[x - 1];
  if (x + 1 < nx && row[x + 1] < d) d = row[x + 1];
  return d;
}

/* Chessboard distance by two sweeps over half of the 26 neighbours each: exact for this metric. Row by row the three or
 * nine neighbours that are whole rows away come first, then the one in the row itself. */
static void sweep(uint8_t *distance, const int n[3], int dir) {
  ptrdiff_t sy = n[0], sz = (ptrdiff_t)n[0] * n[1];
  for (int iz = 0; iz < n[2]; iz++) {
    int z = dir > 0 ? iz : n[2] - 1 - iz;
    for (int iy = 0; iy < n[1]; iy++) {
      int y = dir > 0 ? iy : n[1] - 1 - iy;
      uint8_t *row = distance + z * sz + y * sy;
      for (int dy = -1; dy <= 1; dy++) {
        int yy = y + dy, zz = z - dir;
        if (yy < 0 || yy >= n[1] || zz < 0 || zz >= n[2]) continue;
        const uint8_t *other = row + dy * sy - dir * sz;
        for (int x = 0; x < n[0]; x++) {
          uint8_t d = (uint8_t)(least(other, x, n[0]) + 1);
          if (d < row[x]) row[x] = d;
        }
      }
      if (y - dir >= 0 && y - dir < n[1]) {
        const uint8_t *other = row - dir * sy;
        for (int x = 0; x < n[0]; x++) {
          uint8_t d = (uint8_t)(least(other, x, n[0]) + 1);
          if (d < row[x]) row[x] = d;
        }
      }
      for (int ix = 1; ix < n[0]; ix++) {
        int x = dir > 0 ? ix : n[0] - 1 - ix;
        uint8_t d = (uint8_t)(row[x - dir] + 1);
        if (d < row[x]) row[x] = d;
      }
    }
  }
}

tc_leap *tc_leap_build(const tc_minmax *m, const tc_support *support, GError **error) {
  double start = tc_now_ms();
  size_t count = (size_t)m->blocks[0] * (size_t)m->blocks[1] * (size_t)m->blocks[2], empty = 0;
  tc_leap *leap = calloc(1, sizeof *leap);
  uint8_t *distance = malloc(count + 8);
  if (!leap || !distance) {
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "distance map: out of memory");
    free(leap);
    free(distance);
    return NULL;
  }
  double scale = (support->n - 1) / (support->hi - support->lo);
  for (size_t i = 0; i < count; i++) {
    bool e = is_empty(support, scale, tc_minmax_value(m, 2 * i), tc_minmax_value(m, 2 * i + 1));
    distance[i] = e ? FAR : 0;
    empty += e;
  }
  memset(distance + count, 0, 8);
  if (empty) {
    sweep(distance, m->blocks, 1);
    sweep(distance, m->blocks, -1);
  }
  *leap = (tc_leap){.block = m->block, .reach = m->reach, .blocks = {m->blocks[0], m->blocks[1], m->blocks[2]},
                    .distance = distance, .empty_share = (double)empty / (double)count, .support = support->serial,
                    .bytes = count + 8};
  if (support->used) tc_support_zones(support, &leap->zero_below, &leap->zero_above);
  leap->build_ms = tc_now_ms() - start;
  return leap;
}

void tc_leap_free(tc_leap *leap) {
  if (!leap) return;
  free(leap->distance);
  free(leap);
}
