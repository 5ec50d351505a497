/* The helper's end of wire.h: an order whose voxels go to the daemon. */
#ifndef TC_IMPORT_OUTPUT_H
#define TC_IMPORT_OUTPUT_H

#include "renderer/import/helper/order.h"

typedef struct tc_output {
  uint8_t *ring;
  unsigned next, busy; /* slot to fill; how many the daemon has not taken yet */
  double told;         /* the last fraction */
  int64_t told_us;     /* and when */
} tc_output;

/* Maps the ring and fills the order. */
bool tc_output_init(tc_output *output, tc_order *order, GError **error);

#endif
