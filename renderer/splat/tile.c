/* The farthest depths of a tile's blocks, which decide what is hidden. See tile.h. */
#include "renderer/splat/tile.h"

#include <math.h>

static void find_farthest(tc_splat_tile *t, int bx, int by) {
  float far[TC_TILE_BLOCK];
  for (int x = 0; x < TC_TILE_BLOCK; x++) far[x] = -INFINITY;
  for (int y = by * TC_TILE_BLOCK; y < (by + 1) * TC_TILE_BLOCK; y++) {
    const float *row = t->depth + y * TC_TILE_STRIDE + bx * TC_TILE_BLOCK;
    for (int x = 0; x < TC_TILE_BLOCK; x++) far[x] = row[x] > far[x] ? row[x] : far[x];
  }
  for (int x = 1; x < TC_TILE_BLOCK; x++) far[0] = far[x] > far[0] ? far[x] : far[0];
  t->farthest[by * TC_TILE_BLOCKS + bx] = far[0];
  t->stale[by][bx] = false;
}

/* Rows of blocks. What is right of a row is the next one's first: it makes depths greater at most. */
static void find_farthest_of_four(tc_splat_tile *t, int first, int last) {
  const float *f = t->farthest;
  for (int i = first * TC_TILE_BLOCKS; i < (last + 1) * TC_TILE_BLOCKS; i++) {
    const float *next = f + i + TC_TILE_BLOCKS, above = f[i] > f[i + 1] ? f[i] : f[i + 1],
                below = next[0] > next[1] ? next[0] : next[1];
    t->farthest_of_four[i] = above > below ? above : below;
  }
}

void tc_tile_refresh(tc_splat_tile *t, const int box[4]) {
  const int first = box[1] / TC_TILE_BLOCK, last = box[3] / TC_TILE_BLOCK;
  bool any = false;
  for (int by = first; by <= last; by++)
    for (int bx = box[0] / TC_TILE_BLOCK; bx <= box[2] / TC_TILE_BLOCK; bx++)
      if (t->stale[by][bx]) any = true, find_farthest(t, bx, by);
  if (any) find_farthest_of_four(t, first > 0 ? first - 1 : 0, last);
}

bool tc_tile_hides(const tc_splat_tile *t, int x0, int y0, int x1, int y1, float z) {
  for (int by = y0 / TC_TILE_BLOCK; by <= y1 / TC_TILE_BLOCK; by++)
    for (int bx = x0 / TC_TILE_BLOCK; bx <= x1 / TC_TILE_BLOCK; bx++)
      if (z <= t->farthest[by * TC_TILE_BLOCKS + bx]) return false;
  return true;
}
