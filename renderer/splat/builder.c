#include "renderer/splat/builder.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "renderer/splat/normal.h"

tc_splat_builder tc_splat_builder_new(void) {
  return (tc_splat_builder){g_array_new(FALSE, FALSE, sizeof(tc_splat_brick)), g_array_new(FALSE, FALSE, sizeof(uint32_t)),
                g_array_new(FALSE, FALSE, 1)};
}

void tc_splat_builder_free(tc_splat_builder p) {
  if (p.bricks) g_array_unref(p.bricks);
  if (p.words) g_array_unref(p.words);
  if (p.insets) g_array_unref(p.insets);
}

void tc_splat_begin_brick(const tc_splat_builder *p, const int at[3]) {
  const tc_splat_brick brick = {.first = p->words->len, .at = {at[0], at[1], at[2]}};
  g_array_append_val(p->bricks, brick);
}

void tc_splat_add_word(const tc_splat_builder *p, uint32_t word, uint8_t inset) {
  g_array_append_val(p->words, word);
  g_array_append_val(p->insets, inset);
  g_array_index(p->bricks, tc_splat_brick, p->bricks->len - 1).faces |= word >> 12 & 63;
}

void tc_splat_add(const tc_splat_builder *p, const int at[3], unsigned faces, const double normal[3], uint8_t inset) {
  int folded[2] = {127, 127};
  if (faces) tc_octahedron_fold(normal, 63, folded);
  tc_splat_add_word(p, (uint32_t)(at[0] & 15) | (uint32_t)(at[1] & 15) << 4 | (uint32_t)(at[2] & 15) << 8 | faces << 12 |
                           (uint32_t)folded[0] << 18 | (uint32_t)folded[1] << 25, inset);
}

enum { most_splats = TC_SPLAT_BRICK * TC_SPLAT_BRICK * TC_SPLAT_BRICK };

tc_splat_curve tc_splat_curve_of(const tc_volume_desc *grid) {
  tc_splat_curve c = {0};
  int left[3] = {4, 4, 4}; /* bits of each coordinate not yet used */
  for (int bit = 11; bit >= 0; bit--) {
    int axis = -1;
    for (int k = 0; k < 3; k++)
      if (left[k] && (axis < 0 || ldexp(grid->spacing[k], left[k]) > ldexp(grid->spacing[axis], left[axis]))) axis = k;
    left[axis]--;
    for (int i = 0; i < TC_SPLAT_BRICK; i++) c.share[axis][i] |= (uint16_t)((i >> left[axis] & 1) << bit);
  }
  return c;
}

/* Sorts the last brick's splats by their free faces, and those of equal faces along the curve: neighbours in memory then face away
 * from the eye, lie in a tile and are occluded together. */
static void sort_splats(const tc_splat_builder *p, const tc_splat_brick *brick, const tc_splat_curve *c) {
  const uint32_t n = brick->count, first = brick->first;
  uint32_t *words = &g_array_index(p->words, uint32_t, first), from[most_splats], next[65] = {0};
  uint8_t *insets = &g_array_index(p->insets, uint8_t, first), own[most_splats];
  uint16_t at[most_splats]; /* splat of each number along the curve */
  uint64_t taken[most_splats / 64] = {0};
  memcpy(from, words, n * sizeof *words), memcpy(own, insets, n);
  for (uint32_t i = 0; i < n; i++) {
    const uint32_t w = from[i], number = c->share[0][w & 15] | c->share[1][w >> 4 & 15] | c->share[2][w >> 8 & 15];
    next[(w >> 12 & 63) + 1]++;
    at[number] = (uint16_t)i, taken[number / 64] |= 1ull << number % 64;
  }
  for (int f = 0; f < 64; f++) next[f + 1] += next[f];
  for (uint32_t t = 0; t < most_splats / 64; t++)
    for (uint64_t left = taken[t]; left; left &= left - 1) {
      const uint32_t i = at[64 * t + (uint32_t)__builtin_ctzll(left)], to = next[from[i] >> 12 & 63]++;
      words[to] = from[i], insets[to] = own[i];
    }
}

void tc_splat_end_brick(const tc_splat_builder *p, const tc_splat_curve *c) {
  tc_splat_brick *brick = &g_array_index(p->bricks, tc_splat_brick, p->bricks->len - 1);
  brick->count = p->words->len - brick->first;
  if (!brick->count)
    g_array_set_size(p->bricks, p->bricks->len - 1);
  else if (c)
    sort_splats(p, brick, c);
}

/* Packs a brick. Returns its bytes, at most 10. */
static size_t pack_brick(const tc_splat_brick *brick, const int before[3], uint8_t *to) {
  const int *at = brick->at, x = at[0] - before[0], z = at[2] - before[2];
  const bool many = brick->count >= 63, aside = at[1] != before[1];
  const tc_splat_step step = !aside && !x && z == 1                                          ? TC_SPLAT_NEXT
                             : !aside && !x && z > 0 && z < 256                              ? TC_SPLAT_FURTHER
                             : !aside && x >= 0 && x < 256 && z >= INT8_MIN && z <= INT8_MAX ? TC_SPLAT_COLUMN
                                                                                             : TC_SPLAT_ELSEWHERE;
  uint8_t *p = to;
  *p++ = (uint8_t)((many ? 63 : brick->count) | (unsigned)step << 6);
  if (many) *p++ = (uint8_t)brick->count, *p++ = (uint8_t)(brick->count >> 8);
  if (step == TC_SPLAT_COLUMN) *p++ = (uint8_t)x;
  if (step == TC_SPLAT_FURTHER || step == TC_SPLAT_COLUMN) *p++ = (uint8_t)z;
  for (int k = 0; k < 3 && step == TC_SPLAT_ELSEWHERE; k++) *p++ = (uint8_t)at[k], *p++ = (uint8_t)(at[k] >> 8);
  if (brick->count >= 16) *p++ = brick->faces;
  return (size_t)(p - to);
}

/* Packs the bricks of all builders; sets their number and bytes. NULL: out of memory. */
static uint8_t *pack_bricks(const tc_splat_builder *builders, int count, uint32_t *n_bricks, size_t *bytes) {
  int before[3] = {0};
  size_t n = 0;
  for (int i = 0; i < count; i++) n += builders[i].bricks->len;
  uint8_t *packed = malloc(10 * n + 1), *to = packed, *small;
  for (int i = 0; i < count && packed; i++)
    for (guint b = 0; b < builders[i].bricks->len; b++) {
      const tc_splat_brick *brick = &g_array_index(builders[i].bricks, tc_splat_brick, b);
      to += pack_brick(brick, before, to);
      memcpy(before, brick->at, sizeof before);
    }
  *n_bricks = (uint32_t)n, *bytes = (size_t)(to - packed);
  return packed && (small = realloc(packed, *bytes + 1)) ? small : packed;
}

void tc_splats_free(tc_splats *splats) {
  if (!splats) return;
  free(splats->bricks);
  free(splats->words);
  free(splats->insets);
  free(splats->rims);
  free(splats);
}

tc_splats *tc_splat_join(const tc_splat_builder *builders, int count, GError **error) {
  static atomic_uint_fast64_t serials;
  uint64_t words = 0;
  size_t bricks = 0;
  for (int i = 0; i < count; i++) words += builders[i].words->len;
  if (words > TC_SPLAT_MOST) {
    tc_set_error(error, TC_ERROR_LIMIT, "/splat/threshold",
                 "splat/threshold: the object has more than %u surface voxels; choose a narrower range",
                 TC_SPLAT_MOST);
    return NULL;
  }
  tc_splats *s = calloc(1, sizeof *s);
  if (s)
    s->bricks = pack_bricks(builders, count, &s->n_bricks, &bricks),
    s->words = calloc(words + TC_SPLAT_PAD, sizeof *s->words), s->insets = calloc(words + TC_SPLAT_PAD, 1);
  if (!s || !s->bricks || !s->words || !s->insets) {
    tc_splats_free(s);
    tc_set_error(error, TC_ERROR_MEMORY, NULL, "splats: out of memory");
    return NULL;
  }
  for (int i = 0; i < count; i++) {
    if (builders[i].words->len) {
      memcpy(s->words + s->n, builders[i].words->data, builders[i].words->len * sizeof *s->words);
      memcpy(s->insets + s->n, builders[i].insets->data, builders[i].insets->len);
    }
    s->n += builders[i].words->len;
  }
  s->serial = atomic_fetch_add(&serials, 1) + 1;
  s->bytes = sizeof *s + bricks + 1 + (words + TC_SPLAT_PAD) * (sizeof *s->words + 1);
  return s;
}
