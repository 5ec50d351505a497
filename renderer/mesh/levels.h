/* Levels of detail of clusters: fewer triangles where the difference is too small to see.
 *
 * Neighbouring clusters of a surface form a group. A group is simplified (meshoptimizer; Garland and Heckbert, Surface
 * simplification using quadric error metrics, SIGGRAPH 1997) to a quarter of its triangles, and that level to a quarter again.
 * Vertices on a group's border stay, so that groups of different levels meet without cracks and each group's level can be
 * chosen alone. A level's error is measured instead of taken from the quadrics: the largest distance from a vertex of full
 * detail to the level, or from the middle of a triangle or edge of the level to full detail; a component that is gone counts
 * with its size. */
#ifndef TC_MESH_LEVELS_H
#define TC_MESH_LEVELS_H

#include "renderer/mesh/view.h"

#define TC_LEVELS_LEAST 50000 /* triangles: fewer are drawn in no time */

/* Builds the groups and the clusters of the coarser levels. Checks *stop every few milliseconds (TC_ERROR_CANCELLED);
 * TC_ERROR_MEMORY. */
tc_clusters *tc_levels_make(const tc_clusters *of, const atomic_bool *stop, GError **error);
/* Adds levels to *to, which takes a new serial, and frees `levels`. On TC_ERROR_MEMORY or TC_ERROR_LIMIT *to is unchanged. */
bool tc_levels_add(tc_clusters *to, tc_clusters *levels, GError **error);
/* Upper bound of the levels' bytes. */
size_t tc_levels_bytes(const tc_clusters *of);

/* Chooses for each group the coarsest level whose error is at most so many pixels of the picture: level[n_groups]. Returns
 * the number of triangles. Pure. */
size_t tc_levels_choose(const tc_clusters *mesh, const tc_mesh_view *view, double pixels, uint8_t *level);

/* Builds levels on a thread of its own, of low priority; reads `of` until tc_refining_end(). NULL: the process already has such a
 * thread at work for another mesh, or there is no memory; to be tried again later. */
typedef struct tc_refining tc_refining;
tc_refining *tc_refining_begin(const tc_clusters *of);
bool tc_refining_is_over(const tc_refining *r);
/* Stops the thread within a few milliseconds if it still works. Returns the levels, or NULL: none. r may be NULL. */
tc_clusters *tc_refining_end(tc_refining *r);

#endif
