/* A bit per voxel (inside.h). */
#include "renderer/mesh/inside.h"

#ifdef __SSE2__
#include <emmintrin.h>
#endif
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define STRIP 8 /* rows of blocks along y of a task */

typedef tc_side_word word;

typedef struct pass {
  const void *voxels;
  tc_voxel_type type;
  int dims[3], words;
  float least, most;       /* inside: voxels from least to most, both exact in the voxels' type; most < least: none */
  const tc_minmax *blocks; /* NULL: every voxel is compared */
  int block, strips;       /* width of a block, number of tasks along y */
  word *bits;
  uint8_t *sides;
  uint8_t *word_sides;     /* per worker [words]: side of a word's voxels in a row of blocks; MIXED without blocks */
} pass;

/* Packs sixteen bytes of 0 or 255 into sixteen bits, first byte lowest. */
static word gather_bits(const uint8_t *bytes) {
#ifdef __SSE2__
  return (word)_mm_movemask_epi8(_mm_loadu_si128((const __m128i *)(const void *)bytes));
#else
  word half[2];
  memcpy(half, bytes, sizeof half);
  for (int i = 0; i < 2; i++) half[i] = (half[i] & 0x0101010101010101u) * 0x0102040810204080u >> 56;
  return half[0] | half[1] << 8;
#endif
}

static word word_of(const uint8_t flags[64]) {
  word all = 0;
  for (int i = 0; i < 4; i++) all |= gather_bits(flags + 16 * i) << 16 * i;
  return all;
}

/* Bits of a row of voxels, compared in their own type without widening; sides: [words]. Side of a block's values. */
#define VOXELS_OF(name, type)                                                                                          \
  static void bits_##name(const pass *p, const type *v, const uint8_t *sides, word *out) {                             \
    const type least = (type)p->least, most = (type)p->most;                                                           \
    uint8_t flags[64];                                                                                                 \
    for (int w = 0, left = p->dims[0]; left > 0; w++, left -= 64, v += 64) {                                           \
      if (sides[w] != TC_SIDE_MIXED) {                                                                                 \
        out[w] = sides[w] == TC_SIDE_INSIDE ? ~(word)0 : 0;                                                            \
        continue;                                                                                                      \
      }                                                                                                                \
      if (left >= 64) {                                                                                                \
        for (int i = 0; i < 64; i++) flags[i] = v[i] >= least && v[i] <= most ? 255 : 0;                               \
      } else {                                                                                                         \
        for (int i = 0; i < left; i++) flags[i] = v[i] >= least && v[i] <= most ? 255 : 0;                             \
        memset(flags + left, flags[left - 1], (size_t)(64 - left));                                                    \
      }                                                                                                                \
      out[w] = word_of(flags);                                                                                         \
    }                                                                                                                  \
  }                                                                                                                    \
  static int side_##name(const pass *p, const type *pair) {                                                            \
    const type least = (type)p->least, most = (type)p->most;                                                           \
    if (pair[0] >= least && pair[1] <= most) return TC_SIDE_INSIDE;                                                    \
    return pair[1] < least || pair[0] > most ? TC_SIDE_OUTSIDE : TC_SIDE_MIXED;                                        \
  }
VOXELS_OF(u8, uint8_t)
VOXELS_OF(i8, int8_t)
VOXELS_OF(u16, uint16_t)
VOXELS_OF(i16, int16_t)
VOXELS_OF(f32, float)

static void find_bits(const pass *p, int y, int z, const uint8_t *sides) {
  const size_t row = (size_t)z * (size_t)p->dims[1] + (size_t)y;
  const void *voxels = (const char *)p->voxels + row * (size_t)p->dims[0] * tc_voxel_size(p->type);
  word *out = p->bits + row * (size_t)p->words, any = 0, all = ~(word)0;
  switch (p->type) {
  case TC_U8: bits_u8(p, voxels, sides, out); break;
  case TC_I8: bits_i8(p, voxels, sides, out); break;
  case TC_U16: bits_u16(p, voxels, sides, out); break;
  case TC_I16: bits_i16(p, voxels, sides, out); break;
  case TC_F32:
  case TC_VOXEL_TYPE_COUNT: bits_f32(p, voxels, sides, out); break;
  }
  for (int w = 0; w < p->words; w++) any |= out[w], all &= out[w];
  p->sides[row] = any == 0 ? TC_SIDE_OUTSIDE : all == ~(word)0 ? TC_SIDE_INSIDE : TC_SIDE_MIXED;
}

static int side_of_block(const pass *p, size_t block) {
  const void *pair = (const char *)p->blocks->pairs + 2 * block * tc_voxel_size(p->type);
  switch (p->type) {
  case TC_U8: return side_u8(p, pair);
  case TC_I8: return side_i8(p, pair);
  case TC_U16: return side_u16(p, pair);
  case TC_I16: return side_i16(p, pair);
  case TC_F32:
  case TC_VOXEL_TYPE_COUNT: break;
  }
  return side_f32(p, pair);
}

/* Sides of the words of all rows of voxels in the row of blocks (y, z). */
static void find_sides(const pass *p, int y, int z, uint8_t *sides) {
  const tc_minmax *m = p->blocks;
  const size_t first = ((size_t)z * (size_t)m->blocks[1] + (size_t)y) * (size_t)m->blocks[0];
  for (int w = 0; w < p->words; w++) {
    const int end = MIN((64 * w + 63) / m->block + 1, m->blocks[0]);
    int block = MIN(64 * w / m->block, end - 1);
    sides[w] = (uint8_t)side_of_block(p, first + (size_t)block);
    /* neighbouring blocks share voxels: all are on one side, or one is mixed */
    while (++block < end && sides[w] != TC_SIDE_MIXED)
      if (side_of_block(p, first + (size_t)block) == TC_SIDE_MIXED) sides[w] = TC_SIDE_MIXED;
  }
}

/* The rows of voxels that begin in STRIP rows of blocks. */
static void find_strip(void *context, int task, int worker) {
  const pass *p = context;
  const tc_minmax *m = p->blocks;
  const int block = p->block, z0 = task / p->strips * block, y0 = task % p->strips * STRIP * block;
  uint8_t *sides = p->word_sides + (size_t)worker * (size_t)p->words;
  for (int y = y0; y < MIN(y0 + STRIP * block, p->dims[1]); y += block) {
    if (m) find_sides(p, MIN(y / block, m->blocks[1] - 1), MIN(z0 / block, m->blocks[2] - 1), sides);
    for (int z = z0; z < MIN(z0 + block, p->dims[2]); z++)
      for (int row = y; row < MIN(y + block, p->dims[1]); row++) find_bits(p, row, z, sides);
  }
}

/* turn * voxel >= level as a range of voxels. */
static void set_range(pass *p, float turn, float level) {
  static const float bounds[TC_VOXEL_TYPE_COUNT][2] = {[TC_U8] = {0, 255},
                                                       [TC_I8] = {-128, 127},
                                                       [TC_U16] = {0, 65535},
                                                       [TC_I16] = {-32768, 32767},
                                                       [TC_F32] = {-INFINITY, INFINITY}};
  const float least = bounds[p->type][0], most = bounds[p->type][1];
  if (p->type != TC_F32) level = ceilf(level); /* for integers the next integer is the threshold */
  p->least = turn > 0 ? fmaxf(level, least) : least;
  p->most = turn > 0 ? most : fminf(-level, most);
  if (p->least > most || p->most < least) p->least = most, p->most = least;
}

bool tc_inside_find(tc_inside *inside, const tc_volume *volume, float turn, float level, const tc_minmax *blocks, tc_pool *pool,
                    GError **error) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const size_t rows = (size_t)d->dims[1] * (size_t)d->dims[2];
  pass p = {.voxels = tc_volume_data(volume), .type = d->type, .blocks = blocks, .block = blocks ? blocks->block : TC_SKIP_BLOCK};
  memcpy(p.dims, d->dims, sizeof p.dims);
  set_range(&p, turn, level);
  p.words = (d->dims[0] + 63) / 64;
  p.strips = (d->dims[1] + STRIP * p.block - 1) / (STRIP * p.block);
  p.bits = inside->bits = malloc(rows * (size_t)p.words * sizeof *p.bits);
  p.sides = inside->sides = malloc(rows);
  p.word_sides = calloc((size_t)tc_pool_threads(pool), (size_t)p.words);
  const bool room = p.bits && p.sides && p.word_sides;
  const bool all = room && tc_pool_run(pool, p.strips * ((d->dims[2] + p.block - 1) / p.block), find_strip, &p);
  free(p.word_sides);
  if (!room) tc_set_error(error, TC_ERROR_MEMORY, NULL, "isosurface: out of memory");
  return all || (room && tc_halt_say(tc_pool_halt(pool), error));
}

void tc_inside_end(tc_inside *inside) {
  free(inside->bits);
  free(inside->sides);
}
