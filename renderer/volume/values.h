/* What the values of a volume are like, from its histogram: one walk over the voxels, sixteen bits fine. */
#ifndef TC_VALUES_H
#define TC_VALUES_H

#include "renderer/volume/volume.h"

typedef struct tc_values tc_values;

/* NULL: no memory. */
tc_values *tc_values_of(const tc_volume *volume);
void tc_values_free(tc_values *values); /* NULL is fine */

/* Least and greatest value but for padding: one value at an end of the range, farther from all others than those are
 * from each other (at the lower end, where air and masks are, much farther). */
void tc_values_range(const tc_values *values, double *low, double *high);
/* The share of the voxels within tc_values_range() from `value` on. */
double tc_values_share(const tc_values *values, double value);
/* The value that this share of the voxels from `from` on is below. */
double tc_values_percentile(const tc_values *values, double from, double share);
/* What parts the voxels best: the largest variance between the two sides (Otsu, A threshold selection method from
 * gray-level histograms, IEEE Trans. SMC 9(1), 1979). One value that most voxels have (around a map of signed ones) is
 * on the lower side. */
double tc_values_threshold(const tc_values *values);

#endif
