/* Orders of translucent layers (raster_kernels.h). */
#include <stdlib.h>
#include <string.h>

#include "renderer/mesh/raster_kernels.h"

/* From the nearest on, sample by sample; of equal ones the first number. */
static int by_depth(const void *a, const void *b) {
  const tc_raster_layer *x = a, *y = b;
  const uint32_t sx = x->at / TC_RASTER_PIXELS, sy = y->at / TC_RASTER_PIXELS;
  if (sx != sy) return sx < sy ? -1 : 1;
  if (x->near != y->near) return x->near > y->near ? -1 : 1;
  return (x->id > y->id) - (x->id < y->id);
}

/* Most pixels have few. */
void tc_raster_layers_by_depth(tc_raster_layer *of, size_t n) {
  if (n > 32) {
    qsort(of, n, sizeof *of, by_depth);
    return;
  }
  for (size_t i = 1; i < n; i++) {
    const tc_raster_layer one = of[i];
    size_t at = i;
    for (; at > 0 && by_depth(&of[at - 1], &one) > 0; at--) of[at] = of[at - 1];
    of[at] = one;
  }
}

tc_raster_layer *tc_raster_layers_by_pixel(tc_raster_layers *layers, uint32_t first[TC_RASTER_PIXELS + 1]) {
  tc_raster_layer *sorted = layers->of + layers->room;
  memset(first, 0, (TC_RASTER_PIXELS + 1) * sizeof *first);
  for (size_t i = 0; i < layers->n; i++) first[layers->of[i].at % TC_RASTER_PIXELS]++;
  uint32_t end = 0;
  for (int p = 0; p <= TC_RASTER_PIXELS; p++) end = first[p] += end;
  for (size_t i = layers->n; i-- > 0;) sorted[--first[layers->of[i].at % TC_RASTER_PIXELS]] = layers->of[i];
  return sorted;
}
