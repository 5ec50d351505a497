#include "renderer/mesh/bricks.h"

#include <pthread.h>
#include <stdlib.h>

#define BLOCK_BITS 4 /* of TC_BLOCK */

/* Place along the Hilbert curve (Skilling, Programming the Hilbert curve, AIP Conference Proceedings 707, 2004). */
static unsigned place_of(unsigned x, unsigned y, unsigned z) {
  unsigned at[3] = {x, y, z}, turned = 0, place = 0;
  for (unsigned bit = TC_BLOCK / 2; bit > 1; bit >>= 1)
    for (int k = 0; k < 3; k++) {
      const unsigned differ = at[k] & bit ? 0 : (at[0] ^ at[k]) & (bit - 1);
      if (at[k] & bit) at[0] ^= bit - 1;
      at[0] ^= differ, at[k] ^= differ;
    }
  for (int k = 1; k < 3; k++) at[k] ^= at[k - 1];
  for (unsigned bit = TC_BLOCK / 2; bit > 1; bit >>= 1)
    if (at[2] & bit) turned ^= bit - 1;
  for (int bit = BLOCK_BITS - 1; bit >= 0; bit--)
    for (int k = 0; k < 3; k++) place = place << 1 | ((at[k] ^ turned) >> bit & 1);
  return place;
}

#define BLOCK_BRICKS (TC_BLOCK * TC_BLOCK * TC_BLOCK)
static uint16_t curve[BLOCK_BRICKS]; /* bricks of a block in order: x + TC_BLOCK (y + TC_BLOCK z) */

static void make_curve(void) {
  for (unsigned i = 0; i < BLOCK_BRICKS; i++)
    curve[place_of(i % TC_BLOCK, i / TC_BLOCK % TC_BLOCK, i / (TC_BLOCK * TC_BLOCK))] = (uint16_t)i;
}

bool tc_bricks_begin(tc_bricks *b, const int cells[3]) {
  static pthread_once_t once = PTHREAD_ONCE_INIT;
  size_t bricks = 1, blocks = 1;
  for (int k = 0; k < 3; k++) {
    b->n[k] = (cells[k] + TC_BRICK - 1) / TC_BRICK;
    b->blocks[k] = (b->n[k] + TC_BLOCK - 1) / TC_BLOCK;
    bricks *= (size_t)b->n[k], blocks *= (size_t)b->blocks[k];
  }
  pthread_once(&once, make_curve);
  b->of = calloc(bricks, sizeof *b->of);
  b->first = calloc(blocks, sizeof *b->first);
  return b->of && b->first;
}

void tc_bricks_end(tc_bricks *b) {
  free(b->of);
  free(b->first);
}

static uint32_t *brick_at(const tc_bricks *b, int x, int y, int z) {
  return b->of + ((size_t)z * (size_t)b->n[1] + (size_t)y) * (size_t)b->n[0] + (size_t)x;
}

static void sum_block(void *context, int block, int worker) {
  const tc_bricks *b = context;
  const int x0 = block % b->blocks[0] * TC_BLOCK, y0 = block / b->blocks[0] % b->blocks[1] * TC_BLOCK,
            z0 = block / b->blocks[0] / b->blocks[1] * TC_BLOCK;
  uint32_t sum = 0, any = 0;
  for (int z = z0; z < MIN(z0 + TC_BLOCK, b->n[2]); z++)
    for (int y = y0; y < MIN(y0 + TC_BLOCK, b->n[1]); y++)
      for (int x = x0; x < MIN(x0 + TC_BLOCK, b->n[0]); x++) any |= *brick_at(b, x, y, z);
  if (!any) return;
  for (int i = 0; i < BLOCK_BRICKS; i++) {
    const int at = curve[i], x = x0 + at % TC_BLOCK, y = y0 + at / TC_BLOCK % TC_BLOCK, z = z0 + at / (TC_BLOCK * TC_BLOCK);
    if (x >= b->n[0] || y >= b->n[1] || z >= b->n[2]) continue;
    uint32_t *brick = brick_at(b, x, y, z), n = *brick;
    *brick = sum;
    sum += n;
  }
  b->first[block] = sum;
}

bool tc_bricks_sum(tc_bricks *b, tc_pool *pool, uint64_t *triangles) {
  const int n = b->blocks[0] * b->blocks[1] * b->blocks[2];
  *triangles = 0;
  if (!tc_pool_run(pool, n, sum_block, b)) return false;
  for (int i = 0; i < n; i++) {
    const uint64_t count = b->first[i];
    b->first[i] = *triangles;
    *triangles += count;
  }
  return true;
}
