/* Splats in the making: bricks and words, brick after brick, then joined into a tc_splats. From one thread at a time. */
#ifndef TC_SPLAT_PILE_H
#define TC_SPLAT_PILE_H

#include <math.h>

#include "renderer/splat/splats.h"

typedef struct tc_splat_pile {
  GArray *bricks, *words, *insets;
} tc_splat_pile;

/* Places of a brick along a curve that fills it: the brick is halved twelve times, always across the longest side. A
 * place's number is the sum of its coordinates' shares. */
typedef struct tc_splat_curve {
  uint16_t share[3][TC_SPLAT_BRICK];
} tc_splat_curve;

tc_splat_curve tc_splat_curve_of(const tc_volume_desc *grid);

tc_splat_pile tc_splat_pile_new(void);
void tc_splat_pile_free(tc_splat_pile pile); /* zeros are fine */
/* at: in bricks. A brick that stays empty is dropped at its end. */
void tc_splat_begin_brick(const tc_splat_pile *pile, const int at[3]);
/* at: voxels, of which the place in the brick counts. normal: in LPS, any length; not read without faces. */
void tc_splat_add(const tc_splat_pile *pile, const int at[3], unsigned faces, const double normal[3], uint8_t inset);
/* word, inset: as in tc_splats. */
void tc_splat_add_word(const tc_splat_pile *pile, uint32_t word, uint8_t inset);
/* Sorts its splats; curve NULL: they stay in their order. */
void tc_splat_end_brick(const tc_splat_pile *pile, const tc_splat_curve *curve);
/* The piles one after the other. TC_ERROR_LIMIT: over TC_SPLAT_MOST; _MEMORY. */
tc_splats *tc_splat_join(const tc_splat_pile *piles, int count, GError **error);

/* A surface's distance as an inset. */
static inline uint8_t tc_splat_pack_distance(double voxels) { return (uint8_t)(1 + lround(254 * fmin(fmax(voxels, 0), 1))); }

/* A covector of index coordinates in LPS, of nearly orthogonal axes: lengths count inversely. */
static inline void tc_splat_to_lps(const tc_volume_desc *d, const double index[3], double lps[3]) {
  for (int r = 0; r < 3; r++) {
    lps[r] = 0;
    for (int k = 0; k < 3; k++) lps[r] += d->direction[3 * r + k] * index[k] / d->spacing[k];
  }
}

#endif
