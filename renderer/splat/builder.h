/* Collects splats brick by brick; tc_splat_join() turns one or more builders into a tc_splats. One thread at a time. */
#ifndef TC_SPLAT_BUILDER_H
#define TC_SPLAT_BUILDER_H

#include <math.h>

#include "renderer/splat/splats.h"

typedef struct tc_splat_builder {
  GArray *bricks, *words, *insets;
} tc_splat_builder;

/* A space-filling curve through a brick: the brick is halved twelve times, always across its longest side. A voxel's number along
 * the curve is the sum of its coordinates' shares. */
typedef struct tc_splat_curve {
  uint16_t share[3][TC_SPLAT_BRICK];
} tc_splat_curve;

tc_splat_curve tc_splat_curve_of(const tc_volume_desc *grid);

tc_splat_builder tc_splat_builder_new(void);
void tc_splat_builder_free(tc_splat_builder builder); /* may be all zeros */
/* at: in bricks. tc_splat_end_brick() drops a brick without splats. */
void tc_splat_begin_brick(const tc_splat_builder *builder, const int at[3]);
/* at: voxel; only its position in the brick is used. normal: LPS, any length; not read if there are no faces. */
void tc_splat_add(const tc_splat_builder *builder, const int at[3], unsigned faces, const double normal[3], uint8_t inset);
/* word, inset: as in tc_splats. */
void tc_splat_add_word(const tc_splat_builder *builder, uint32_t word, uint8_t inset);
/* Sorts the brick's splats along the curve; NULL: keeps their order. */
void tc_splat_end_brick(const tc_splat_builder *builder, const tc_splat_curve *curve);
/* Joins the splats of several builders in their order. TC_ERROR_LIMIT above TC_SPLAT_MOST, TC_ERROR_MEMORY. */
tc_splats *tc_splat_join(const tc_splat_builder *builders, int count, GError **error);

/* Inset of a surface at this distance. */
static inline uint8_t tc_splat_pack_distance(double voxels) { return (uint8_t)(1 + lround(254 * fmin(fmax(voxels, 0), 1))); }

/* Converts a covector from index coordinates to LPS, for nearly orthogonal axes: divides by the spacing. */
static inline void tc_splat_to_lps(const tc_volume_desc *d, const double index[3], double lps[3]) {
  for (int r = 0; r < 3; r++) {
    lps[r] = 0;
    for (int k = 0; k < 3; k++) lps[r] += d->direction[3 * r + k] * index[k] / d->spacing[k];
  }
}

#endif
