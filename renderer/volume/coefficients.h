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

/* A sealed f32 volume in the same place, of the same unit; the caller's. They reach beyond the voxels' range where the
 * data turn sharply. pool NULL: all on the caller. TC_ERROR_MEMORY. */
tc_volume *tc_coefficients_make(const tc_volume *volume, tc_pool *pool, GError **error);

#endif
