/* B-spline coefficients of a volume (prefiltering). The cubic filter smooths voxels; applied to the coefficients, it
 * interpolates them.
 *
 * Along each axis c solves (c[i-1] + 4 c[i] + c[i+1]) / 6 = v[i], with the edge coefficient repeated outside as the
 * filter does (Unser, Aldroubi and Eden, B-spline signal processing, IEEE Trans. Signal Processing 41(2), 1993). */
#ifndef TC_COEFFICIENTS_H
#define TC_COEFFICIENTS_H

#include "renderer/base/pool.h"
#include "renderer/volume/volume.h"

/* Memory in bytes: four per voxel. */
uint64_t tc_coefficients_bytes(const tc_volume *volume);

/* Coefficients under construction. 512^3 voxels take a second, so the work can be interrupted. */
typedef struct tc_coefficients tc_coefficients;

tc_coefficients *tc_coefficients_begin(const tc_volume *volume, GError **error);
/* Continues until the coefficients are complete. False: the pool was halted; call again to continue. pool NULL: on the
 * calling thread. */
bool tc_coefficients_go_on(tc_coefficients *c, const tc_volume *volume, tc_pool *pool);
/* Progress, never decreasing. */
int64_t tc_coefficients_steps(const tc_coefficients *c);
uint64_t tc_coefficients_held(const tc_coefficients *c); /* bytes allocated */
/* Frees c and returns the complete coefficients: a sealed f32 volume of the same geometry and unit; the caller unrefs.
 * Coefficients exceed the range of the voxels at sharp peaks. */
tc_volume *tc_coefficients_take(tc_coefficients *c);
void tc_coefficients_free(tc_coefficients *c); /* NULL is fine */

/* begin, go_on and take in one call. NULL with TC_ERROR_MEMORY or the halt's error. */
tc_volume *tc_coefficients_make(const tc_volume *volume, tc_pool *pool, GError **error);

#endif
