/* The surfaces that a frame of mode mesh draws, as the parts of one mesh in clusters. Made in steps, so that what a pause
 * interrupts goes on where it was. */
#ifndef TC_MESH_SURFACES_H
#define TC_MESH_SURFACES_H

#include "renderer/mesh/clusters.h"

typedef struct tc_surfaces_wish {
  const tc_volume *volume; /* isosurfaces are of it; positions are relative to its middle */
  const tc_volume *labels; /* of whole numbers; NULL where no source needs it */
  const tc_mesh_source *sources; /* [n_sources]; NULL: every label but 0 that `shows` */
  size_t n_sources;
  bool (*shows)(const void *user, uint32_t label);
  const void *user;
  const tc_clusters *like; /* what it has of the sources is copied; or NULL */
  uint64_t max_bytes;      /* of meshes while they are made; TC_ERROR_LIMIT */
  tc_pool *pool;           /* and its halt */
  atomic_int *permille;    /* is told how far all are; or NULL */
} tc_surfaces_wish;

/* Of a scene's list: whether it is drawn at all. */
static inline bool tc_mesh_surface_shows(const tc_mesh_surface *s) { return s->visible && s->opacity > 0; }

/* Modes that are of the volume draw the surfaces in it. */
static inline bool tc_mesh_is_within(const tc_scene *s) {
  return s->mesh.with_volume && s->mesh.n_surfaces && (s->mode == TC_MODE_DVR || s->mode == TC_MODE_MIP);
}

/* A label from a voxel's bits; 0: none. */
uint32_t tc_mesh_label_of(const tc_volume_desc *d, int bits);

/* A copy with normals, as all of a list's surfaces have them; of NULL an empty mesh. */
tc_mesh *tc_mesh_with_normals(const tc_mesh *mesh, const tc_mesh_options *options, GError **error);

bool tc_mesh_source_equal(const tc_mesh_source *a, const tc_mesh_source *b);

typedef struct tc_surfaces tc_surfaces; /* in the making */

tc_surfaces *tc_surfaces_begin(void);
/* True: all there. False with *error set; called again with the same wish (but for `like`) it goes on. */
bool tc_surfaces_go_on(tc_surfaces *surfaces, const tc_surfaces_wish *wish, GError **error);
int64_t tc_surfaces_steps(const tc_surfaces *surfaces); /* grows */
size_t tc_surfaces_held(const tc_surfaces *surfaces);   /* bytes of what is made so far */
/* The clusters, and the end of what made them: a part for each source, in order. */
tc_clusters *tc_surfaces_take(tc_surfaces *surfaces);
void tc_surfaces_free(tc_surfaces *surfaces); /* NULL is fine */

#endif
