/* Statistics of a volume's values (range without padding, percentiles, threshold), from a 16-bit histogram taken in
 * one pass. */
#ifndef TC_VALUES_H
#define TC_VALUES_H

#include "renderer/volume/volume.h"

typedef struct tc_values tc_values;

/* NULL: no memory. */
tc_values *tc_values_of(const tc_volume *volume);
void tc_values_free(tc_values *values); /* NULL is fine */

/* Least and greatest value without padding. Padding is a single value at an end of the range that is farther from
 * all other values than they are apart (much farther at the lower end, where air and masks are). */
void tc_values_range(const tc_values *values, double *low, double *high);
/* Share of voxels >= value, among those within tc_values_range(). */
double tc_values_share(const tc_values *values, double value);
/* The value below which `share` of the voxels >= from lie. */
double tc_values_percentile(const tc_values *values, double from, double share);
/* Otsu's threshold: maximises the variance between both sides (A threshold selection method from gray-level
 * histograms, IEEE Trans. SMC 9(1), 1979). A single value that most voxels have, as around a map of signed values,
 * is on the lower side. */
double tc_values_threshold(const tc_values *values);

#endif
