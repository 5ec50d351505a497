/* What building clusters and joining them share. Private to mesh/. */
#ifndef TC_MESH_CLUSTERS_JOIN_H
#define TC_MESH_CLUSTERS_JOIN_H

#include "renderer/mesh/clusters.h"

/* One instruction each; the first where the second is no number. */
static inline float lesser(float a, float b) { return b < a ? b : a; }
static inline float greater(float a, float b) { return b > a ? b : a; }

uint64_t tc_clusters_next_serial(void);
size_t tc_clusters_array_bytes(const tc_clusters *clusters); /* of the arrays */
bool tc_clusters_no_memory(GError **error); /* false, with TC_ERROR_MEMORY */

#endif
