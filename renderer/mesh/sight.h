/* Bounds of a cluster before any of its vertices is read: the pixels it may touch and its nearest point. Shared by the
 * CPU and GL rasterisers. Pure. */
#ifndef TC_MESH_SIGHT_H
#define TC_MESH_SIGHT_H

#include "renderer/mesh/view.h"

typedef struct tc_sight {
  int16_t x0, y0, x1, y1; /* pixels it may touch, both ends included; x1 < x0: none */
  float nearest;          /* upper bound of its nearness */
  uint32_t planes;        /* bits of the clip planes that may cut it */
  uint16_t part;          /* the cluster's */
} tc_sight;

double tc_sight_slack(const tc_clusters *mesh); /* bound on the rounding of single precision, mm */
/* one_sided: back faces are invisible. *away: the cluster is invisible because it faces away, not because it is outside. */
tc_sight tc_sight_of(const tc_mesh_view *view, const tc_cluster *cluster, double slack, bool one_sided, bool *away);

#endif
