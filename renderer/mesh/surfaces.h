/* The surfaces that a frame of mode mesh draws, as clusters: a volume's isosurface, or one smooth surface for each label.
 * Made in steps, so that what a pause interrupts goes on where it was. */
#ifndef TC_MESH_SURFACES_H
#define TC_MESH_SURFACES_H

#include "renderer/mesh/clusters.h"

typedef struct tc_surfaces_wish {
  const tc_volume *volume;
  double iso;
  const tc_volume *labels; /* not NULL: of these, of whole numbers, instead; those but 0 that `shows` */
  bool (*shows)(const void *user, uint32_t label);
  const void *user;
  uint64_t max_bytes; /* of meshes while they are made; TC_ERROR_LIMIT */
  tc_pool *pool;      /* and its halt */
} tc_surfaces_wish;

typedef struct tc_surfaces tc_surfaces; /* in the making */

tc_surfaces *tc_surfaces_begin(void);
/* True: all there. False with *error set; called again with the same wish it goes on. */
bool tc_surfaces_go_on(tc_surfaces *surfaces, const tc_surfaces_wish *wish, GError **error);
int64_t tc_surfaces_steps(const tc_surfaces *surfaces); /* grows */
/* The clusters, and the end of what made them. A label's surface has its number in tc_clusters.labels. */
tc_clusters *tc_surfaces_take(tc_surfaces *surfaces);
void tc_surfaces_free(tc_surfaces *surfaces); /* NULL is fine */

#endif
