/* What is known of a cluster before any of its vertices is looked at: where it may be seen, and how near. For every
 * rasteriser. Pure. */
#ifndef TC_MESH_SIGHT_H
#define TC_MESH_SIGHT_H

#include "renderer/mesh/view.h"

typedef struct tc_sight {
  int16_t x0, y0, x1, y1; /* pixels it may touch, both ends included; x1 < x0: none */
  float nearest;          /* nothing of it is nearer */
  uint32_t planes;        /* bits of those that may cut it */
} tc_sight;

double tc_sight_slack(const tc_clusters *mesh); /* mm that single precision may be off by */
/* one_sided: what faces away is not seen. *away: that was the reason, not that it is outside. */
tc_sight tc_sight_of(const tc_mesh_view *view, const tc_cluster *cluster, double slack, bool one_sided, bool *away);

#endif
