/* The helper's side of wire.h: an order whose voxels go to the daemon. */
#ifndef TC_IMPORT_OUTPUT_H
#define TC_IMPORT_OUTPUT_H

#include "renderer/import/helper/order.h"

typedef struct tc_output {
  uint8_t *ring;
  unsigned next, busy; /* next slot to fill; number of slots that the daemon has not returned */
  double told;         /* last fraction reported */
  int64_t told_us;     /* time of that report */
} tc_output;

/* Maps the ring and fills in the order's functions. */
bool tc_output_init(tc_output *output, tc_order *order, GError **error);

#endif
