/* Minima and maxima of blocks, for callers that store them in another form (skip/fine.h). */
#ifndef TC_SKIP_MINMAX_EACH_H
#define TC_SKIP_MINMAX_EACH_H

#include "renderer/skip/skip.h"

/* Number of blocks of this width along each axis of a volume; returns the total. */
size_t tc_minmax_blocks(const tc_volume *volume, int block, int blocks[3]);

/* Takes `count` pairs of minima and maxima, those of the blocks from number `first` on: whole rows. Any worker of the pool. */
typedef void (*tc_minmax_sink)(void *user, size_t first, size_t count, const void *pairs);

/* Continues to hand the pairs of all blocks to a sink; the grid's own are not used. True once all are. False: the pool was halted
 * (call again), or TC_ERROR_MEMORY. */
bool tc_minmax_each(tc_minmax *minmax, const tc_volume *volume, tc_pool *pool, tc_minmax_sink sink, void *user, GError **error);

#endif
