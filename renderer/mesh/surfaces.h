/* Builds the surfaces that a frame of mode mesh draws, as parts of one set of clusters. The work is split into steps, so that
 * a paused build continues where it stopped. */
#ifndef TC_MESH_SURFACES_H
#define TC_MESH_SURFACES_H

#include "renderer/mesh/clusters.h"

typedef struct tc_surfaces_wish {
  const tc_volume *volume; /* source of isosurfaces; positions are relative to its centre */
  const tc_minmax *blocks; /* of the volume; NULL: isosurfaces are extracted without */
  const tc_volume *labels; /* integer label volume; NULL if no source needs one */
  const tc_mesh_source *sources; /* [n_sources]; NULL: every label but 0 for which shows() is true */
  size_t n_sources;
  bool (*shows)(const void *user, uint32_t label);
  const void *user;
  const tc_clusters *like; /* earlier result: surfaces of equal sources are copied from it; or NULL */
  uint64_t max_bytes;      /* limit on meshes under construction; TC_ERROR_LIMIT above it */
  tc_pool *pool;           /* its halt stops the build */
  atomic_int *permille;    /* receives the progress; or NULL */
} tc_surfaces_wish;

/* Whether a surface of the scene's list is drawn. */
static inline bool tc_mesh_surface_shows(const tc_mesh_surface *s) { return s->visible && s->opacity > 0; }

/* Whether a volume mode draws the surfaces inside the volume (mesh.withVolume). */
static inline bool tc_mesh_is_within(const tc_scene *s) {
  return s->mesh.with_volume && s->mesh.n_surfaces && (s->mode == TC_MODE_DVR || s->mode == TC_MODE_MIP);
}

/* The label that a voxel's bits stand for; 0: no label. */
uint32_t tc_mesh_label_of(const tc_volume_desc *d, int bits);

bool tc_mesh_source_equal(const tc_mesh_source *a, const tc_mesh_source *b);

typedef struct tc_surfaces tc_surfaces; /* a build in progress */

tc_surfaces *tc_surfaces_begin(void);
/* Returns true when all surfaces are built; otherwise false with *error set. After a pause, another call with the same wish
 * (`like` may differ) continues the build. */
bool tc_surfaces_go_on(tc_surfaces *surfaces, const tc_surfaces_wish *wish, GError **error);
int64_t tc_surfaces_steps(const tc_surfaces *surfaces); /* steps done; grows with every progress */
size_t tc_surfaces_held(const tc_surfaces *surfaces);   /* bytes built so far */
/* Returns the clusters, one part for each source in order, and frees the build. The caller owns the clusters. */
tc_clusters *tc_surfaces_take(tc_surfaces *surfaces);
void tc_surfaces_free(tc_surfaces *surfaces); /* NULL is fine */

#endif
