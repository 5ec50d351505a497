/* Minima and maxima of blocks row by row, for callers that store them in another form (skip/fine.h). */
#ifndef TC_SKIP_MINMAX_ROWS_H
#define TC_SKIP_MINMAX_ROWS_H

#include "renderer/skip/skip.h"

/* Number of blocks of this width along each axis of a volume; returns the total. */
size_t tc_minmax_blocks(const tc_volume *volume, int block, int blocks[3]);

/* Computes the pairs of one row of blocks into `pairs`; the grid's own pairs are not used. scratch: room for two rows
 * of voxels. */
void tc_minmax_row(const tc_minmax *minmax, const tc_volume *volume, int by, int bz, void *scratch, void *pairs);

#endif
