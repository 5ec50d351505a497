/* The 1-D tables of the classifications approximate, post and linearized, which need no pre-integration table (NUMERICS
 * section 2).
 *
 * tau is the extinction (1/mm), L the colour in the compositing space, x a value in nodes (preintegration.h). Entries are (L
 * tau, tau) in 1/mm, and do not depend on the length of a segment. For a segment from x_f to x_b kernels take (k, m):
 *   post          L tau and tau at the front sample: a rectangle rule, first order;
 *   approximate   the means of L tau and tau over [x_f, x_b];
 *   linearized    the same means.
 * With d the segment's own length, so that a ray's shorter last segment is exact too, the segment has
 *   opacity a = 1 - exp(-m d) and colour k a / m;     linearized: a = min(m d, 1).
 * The colour k d alone would ignore self-attenuation: it is too bright, and of first order. Scaled by a / (m d), the
 * colour is at most a max(L), exact where L is constant, and of second order.
 *
 * A mean is a sum over whole node intervals and two partial ones at the ends, where tau and L tau are modelled as
 * linear within the interval, with the interval's exact means. Differences of prefix sums would lose a thin stretch
 * behind a stiff one by cancellation, so sums are stored without subtraction (a disjoint sparse table): level l divides
 * the nodes into blocks of 2^(l+1), and each node stores the sum between itself and the middle of its block. Nodes p <
 * q lie on opposite sides of a middle of level msb(p xor q), and their two entries there add up to the sum between
 * them. */
#ifndef TC_INTEGRALS_H
#define TC_INTEGRALS_H

#include "renderer/classify/preintegration.h"

typedef struct tc_integrals {
  int n;            /* nodes within the range of the data */
  double lo, hi;    /* voxel values (not rescaled) of nodes 0 and n-1 */
  float *entries;   /* [2 (n+1)][4], then [levels][n+1][4], then one entry of padding */
  int levels_start; /* entries before the levels; level 0 is all 0 (p = q), level l+1 has blocks of 2^(l+1) nodes */
  size_t count;     /* entries in all; those at 2 i and 2 i + 1 are the limits at both ends of node interval i */
  size_t bytes;
  uint64_t serial;  /* unique in the process */
  double build_ms;
} tc_integrals;

/* True for the classifications that read these tables. */
bool tc_integrals_serve(tc_classification classification);

/* Chooses nodes and voxel range for p->tf: 256 over the type's range for 8-bit data, else 1024, or 4096 if knots are
 * close. */
void tc_integrals_choose(const tc_volume *volume, tc_table_params *p);

/* Ignores params->step_mm and ->bits. The caller frees. NULL with TC_ERROR_MEMORY or the error of the halt (NULL:
 * none); a halted build starts anew next time. */
tc_integrals *tc_integrals_build(const tc_table_params *params, const tc_halt *halt, GError **error);
void tc_integrals_free(tc_integrals *integrals); /* NULL is fine */

#endif
