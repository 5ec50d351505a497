/* Histogram of a volume's values. */
#ifndef TC_VOLUME_HISTOGRAM_H
#define TC_VOLUME_HISTOGRAM_H

#include "renderer/volume/volume.h"

/* Counts of voxels (not NaN) in `bins` equal bins over [stats.min, stats.max]; edges[bins + 1] in the volume's unit. */
void tc_volume_histogram(const tc_volume *volume, int bins, uint64_t *counts, double *edges);

#endif
