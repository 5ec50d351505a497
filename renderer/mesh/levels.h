/* Levels of detail of clusters: fewer triangles where nobody can see the difference.
 *
 * Neighbouring clusters of a surface are a group. A group is simplified (meshoptimizer; Garland and Heckbert, Surface
 * simplification using quadric error metrics, SIGGRAPH 1997) to at least a quarter of its triangles, and that to a quarter again,
 * while the vertices of its border stay: groups of any levels fit together without a crack, so that each is chosen by
 * itself. The error of a level is measured, not the quadrics' own: how far any vertex of the full surface is from the
 * level, and the middle of any of the level's triangles and edges from the full surface; a piece that is gone counts as far as
 * it is large. */
#ifndef TC_MESH_LEVELS_H
#define TC_MESH_LEVELS_H

#include "renderer/mesh/view.h"

#define TC_LEVELS_LEAST 50000 /* triangles: fewer are drawn in no time */

/* Clusters of the levels alone, with `groups` and their places in them. *stop is looked at every few milliseconds
 * (TC_ERROR_CANCELLED); TC_ERROR_MEMORY. */
tc_clusters *tc_levels_make(const tc_clusters *of, const atomic_bool *stop, GError **error);
/* *to has them from now on, and another serial. TC_ERROR_MEMORY, TC_ERROR_LIMIT: it is as it was. `levels` is gone. */
bool tc_levels_add(tc_clusters *to, tc_clusters *levels, GError **error);
/* What such clusters may take, in bytes, from above. */
size_t tc_levels_bytes(const tc_clusters *of);

/* For each group its coarsest level whose error is at most so many pixels of the picture: level[n_groups]. Pure. Gives back
 * how many triangles that is. */
size_t tc_levels_choose(const tc_clusters *mesh, const tc_mesh_view *view, double pixels, uint8_t *level);

/* Levels that are made on a thread of their own, of low priority. `of` is read until tc_refining_end(). NULL: no thread. */
typedef struct tc_refining tc_refining;
tc_refining *tc_refining_begin(const tc_clusters *of);
bool tc_refining_is_over(const tc_refining *r);
/* Stops it where it goes on, within a few milliseconds. What came of it, NULL: nothing. r NULL is fine. */
tc_clusters *tc_refining_end(tc_refining *r);

#endif
