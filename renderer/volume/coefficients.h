/* B-spline coefficients of a volume: with them in the voxels' place the cubic filter, which smooths, passes through
 * every voxel.
 *
 * Along each axis c solves (c[i-1] + 4 c[i] + c[i+1]) / 6 = v[i] with the edge's coefficient repeated outside, as the
 * filter reads it (Unser, Aldroubi and Eden, B-spline signal processing, IEEE Trans. Signal Processing 41(2), 1993). */
#ifndef TC_COEFFICIENTS_H
#define TC_COEFFICIENTS_H

#include "renderer/pool.h"
#include "renderer/volume/volume.h"

/* Bytes that they take: four a voxel. */
uint64_t tc_coefficients_bytes(const tc_volume *volume);

/* Coefficients in the making: a second for 512^3 voxels, hence in parts. */
typedef struct tc_coefficients tc_coefficients;

tc_coefficients *tc_coefficients_begin(const tc_volume *volume, GError **error);
/* Goes on until they are made, or the pool's halt: false then, to be called again. pool NULL: all on the caller. */
bool tc_coefficients_go_on(tc_coefficients *c, const tc_volume *volume, tc_pool *pool);
/* Indices done so far, of any pass: it grows. */
int64_t tc_coefficients_steps(const tc_coefficients *c);
/* Those that are made, and ends c: a sealed f32 volume in the same place, of the same unit; the caller's. They reach
 * beyond the voxels' range where the data turn sharply. */
tc_volume *tc_coefficients_take(tc_coefficients *c);
void tc_coefficients_free(tc_coefficients *c); /* NULL is fine */

/* All at once. TC_ERROR_MEMORY, or what the pool's halt says. */
tc_volume *tc_coefficients_make(const tc_volume *volume, tc_pool *pool, GError **error);

#endif
