/* The order in which clusters are cut from the triangles of any mesh. Private to mesh/. */
#ifndef TC_MESH_CLUSTERS_SORT_H
#define TC_MESH_CLUSTERS_SORT_H

#include "renderer/mesh/mesh.h"

typedef struct tc_sorted {
  uint32_t (*triangles)[3]; /* [n], along a Morton curve; freed by free(), after a failure too */
  size_t n;                 /* without degenerate triangles and those with a vertex that is not finite */
  uint64_t border;          /* sum of the degenerate ones (tc_mesh_triangle_sum) */
} tc_sorted;

/* box: lowest and highest coordinates of the mesh's finite vertices. Parallel over the pool, whose halt stops it
 * (TC_ERROR_CANCELLED, _PAUSED); TC_ERROR_MEMORY. */
bool tc_clusters_sort(const tc_mesh *mesh, const float box[2][3], tc_pool *pool, tc_sorted *sorted, GError **error);

#endif
