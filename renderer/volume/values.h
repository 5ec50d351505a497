/* Statistics of a volume's values (range without padding, percentiles, threshold), from a 16-bit histogram taken in
 * one pass. */
#ifndef TC_VALUES_H
#define TC_VALUES_H

#include "renderer/volume/volume.h"

typedef struct tc_values tc_values;

/* Takes the histogram. NULL: out of memory. */
tc_values *tc_values_of(const tc_volume *volume);
void tc_values_free(tc_values *values); /* NULL is fine */

/* Range of the values without padding. Padding is a single value at an end of the range whose distance to the other
 * values exceeds their own range (several times at the lower end, where air and masks are). */
void tc_values_range(const tc_values *values, double *low, double *high);
/* Share of voxels >= value, among those within tc_values_range(). */
double tc_values_share(const tc_values *values, double value);
/* Percentile among the voxels >= from: `share` (0..1) of them lie below the returned value. */
double tc_values_percentile(const tc_values *values, double from, double share);
/* Otsu's threshold: maximises the between-class variance (A threshold selection method from gray-level histograms, IEEE
 * Trans. SMC 9(1), 1979). If most voxels have one value, as the background of a signed map, the threshold is above
 * that value. */
double tc_values_threshold(const tc_values *values);

#endif
