/* A mesh cut into clusters of neighbouring triangles: what the rasteriser (raster.h) draws.
 *
 * Triangles are cut where a cluster is full, along a curve that fills space: the order of an extracted mesh (bricks.h), or a
 * Morton curve through the middles of any other's triangles. A cluster is therefore compact: one test of its sphere culls all of its triangles when they are outside the view or occluded, one test of its
 * cone when all of them face away. Within a cluster vertices are numbered by bytes, which is less than the 16 bits of
 * an index buffer (Knigavko and Avrunin) and needs no more than its own vertices in the cache. About 15 bytes a
 * triangle, 18 with colours; the mesh it was made from is not needed any more. Immutable; any thread may read it. */
#ifndef TC_MESH_CLUSTERS_H
#define TC_MESH_CLUSTERS_H

#include <stdatomic.h>

#include "renderer/mesh/mesh.h"
#include "renderer/scene/scene.h"

enum { TC_CLUSTER_VERTICES = 96, TC_CLUSTER_TRIANGLES = 128, TC_CLUSTER_PAD = 16, TC_LEVELS = 3 };

typedef struct tc_cluster {
  float centre[3], radius; /* sphere about its vertices, relative to the mesh's origin */
  float axis[3], spread;   /* unit; every normal is within asin(spread) of it; spread 2: in any direction */
  uint32_t vertex;         /* its first; a multiple of TC_CLUSTER_PAD */
  uint32_t triangle;       /* its first; a multiple of TC_CLUSTER_PAD */
  uint8_t n_vertices, n_triangles;
  uint16_t part; /* index into tc_clusters.parts */
  uint32_t group : 30, level : 2; /* drawn where the group is shown at this level of detail (levels.h); 0: full detail */
} tc_cluster;

/* Neighbouring clusters that change their level of detail together (levels.h). */
typedef struct tc_group {
  float centre[3], radius;       /* bounding sphere */
  float error[TC_LEVELS];        /* mm; 0 at full detail, INFINITY for a level that does not exist */
  uint32_t triangles[TC_LEVELS]; /* number at each level */
  uint32_t first, n;             /* clusters of full detail */
} tc_group;

/* The source of a surface: equal sources give the same surface. */
typedef struct tc_mesh_source {
  tc_surface_source kind;
  uint32_t label;
  double iso, plane[4]; /* LPS: normal . p + plane[3] = 0 */
  uint64_t serial;     /* of the volume or mesh */
  const tc_mesh *mesh; /* read only while the surface is built */
} tc_mesh_source;

typedef struct tc_part {
  tc_mesh_source of; /* of.mesh NULL */
  size_t first, n;   /* clusters */
  bool colored; /* its vertices have colours; otherwise its entries of tc_clusters.colors are not read */
  bool closed;       /* every edge has two triangles and normals point outwards: back faces are invisible from outside */
} tc_part;

typedef struct tc_clusters {
  double origin[3];        /* LPS mm; as of the mesh */
  float centre[3], radius; /* sphere about all */
  size_t n, n_triangles;
  tc_group *groups; /* [n_groups]; n_groups 0: no levels of detail */
  size_t n_groups;
  tc_part *parts; /* [n_parts]: one for each surface, at least one; with the clusters of full detail */
  size_t n_parts;
  size_t vertex_room, triangle_room; /* padded */
  tc_cluster *clusters;              /* [n] */
  float *positions;    /* a cluster's start at 3 * vertex: all x, all y, all z, each padded to TC_CLUSTER_PAD */
  uint32_t *normals;   /* [vertex_room], octahedral, 16 bits each of x (low) and y; NULL where the mesh has none */
  uint32_t *colors;    /* [vertex_room], as tc_mesh has them; NULL where no part has any */
  uint8_t *triangles;  /* a cluster's start at 3 * triangle: all first corners, all second, all third, padded likewise */
  size_t bytes;
  uint64_t serial; /* unique in the process */
  int refined;     /* how often levels of detail were added */
  struct tc_refining *refining; /* what is made for that beside; NULL: nothing. The owner's */
} tc_clusters;

/* Builds the clusters of a mesh, without degenerate triangles and triangles with a vertex that is not finite. Parallel over the
 * pool, whose halt stops it (TC_ERROR_CANCELLED, _PAUSED); TC_ERROR_MEMORY. share: reports progress; may be NULL. */
tc_clusters *tc_clusters_make(const tc_mesh *mesh, tc_pool *pool, const tc_share *share, GError **error);
/* Adds `more`, which has one part, the same origin and normals if *all has them, and frees it; *all NULL: `more` is the first.
 * On TC_ERROR_MEMORY or TC_ERROR_LIMIT *all is unchanged and `more` freed. */
bool tc_clusters_add(tc_clusters **all, tc_clusters *more, const tc_mesh_source *of, GError **error);
/* Empty clusters to append to, with the origin of `like`, and normals if `like` has them. TC_ERROR_MEMORY. */
tc_clusters *tc_clusters_none(const tc_clusters *like, GError **error);
/* Appends copies of the clusters, and takes a new serial. On TC_ERROR_MEMORY or TC_ERROR_LIMIT nothing changes. */
bool tc_clusters_append(tc_clusters *to, const tc_clusters *more, GError **error);
/* A copy of one part at full detail. TC_ERROR_MEMORY. */
tc_clusters *tc_clusters_copy_part(const tc_clusters *all, size_t part, GError **error);
void tc_clusters_free(tc_clusters *clusters); /* NULL is fine */

/* Number of triangles at full detail. */
static inline size_t tc_clusters_in_full(const tc_clusters *c) {
  size_t n = c->n_groups ? 0 : c->n_triangles;
  for (size_t i = 0; i < c->n_groups; i++) n += c->groups[i].triangles[0];
  return n;
}

/* Padded length of a cluster's arrays. */
static inline size_t tc_cluster_padded(size_t n) { return (n + TC_CLUSTER_PAD - 1) / TC_CLUSTER_PAD * TC_CLUSTER_PAD; }

#endif
