/* A mesh cut into clusters of neighbouring triangles: what the rasteriser (raster.h) draws.
 *
 * Triangles are sorted along a Morton curve through their middles and cut where a cluster is full, so that a cluster is
 * compact: one test of its sphere leaves out all of its triangles where they are outside the view or hidden, one of its
 * cone where all of them face away. Within a cluster vertices are numbered by bytes, which is less than the 16 bits of
 * an index buffer (Knigavko and Avrunin) and needs no more than its own vertices in the cache. About 15 bytes a
 * triangle; the mesh it was made from is not needed any more. Immutable; any thread may read it. */
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
  uint32_t triangle;       /* its first; likewise */
  uint8_t n_vertices, n_triangles;
  uint16_t part; /* number of it in tc_clusters.parts */
  uint32_t group : 30, level : 2; /* levels.h: it is drawn where the group has this level; 0: the full one */
} tc_cluster;

/* Neighbouring clusters whose level of detail is one (levels.h). */
typedef struct tc_group {
  float centre[3], radius;       /* sphere about it */
  float error[TC_LEVELS];        /* mm; 0 of the full one, INFINITY where there is no such level */
  uint32_t triangles[TC_LEVELS]; /* how many */
  uint32_t first, n;             /* clusters of the full one */
} tc_group;

/* What a surface is made from: equal sources are one surface. */
typedef struct tc_mesh_source {
  tc_surface_source kind;
  uint32_t label;
  double iso, plane[4]; /* LPS: normal . p + plane[3] = 0 */
  uint64_t serial;     /* of the volume or mesh that it is of */
  const tc_mesh *mesh; /* read while the surface is made */
} tc_mesh_source;

typedef struct tc_part {
  tc_mesh_source of; /* of.mesh NULL */
  size_t first, n;   /* clusters */
  bool closed;       /* every edge has two triangles, and normals point outwards: from outside no back of one is seen */
} tc_part;

typedef struct tc_clusters {
  double origin[3];        /* LPS mm; as of the mesh */
  float centre[3], radius; /* sphere about all */
  size_t n, n_triangles;
  tc_group *groups; /* [n_groups]; none: there are no levels of detail */
  size_t n_groups;
  tc_part *parts; /* [n_parts]: surfaces, at least one; their clusters are the full ones */
  size_t n_parts;
  size_t vertex_room, triangle_room; /* padded */
  tc_cluster *clusters;              /* [n] */
  float *positions;    /* of a cluster: 3 * vertex on, all x, all y, all z, each padded to TC_CLUSTER_PAD */
  uint32_t *normals;   /* [vertex_room], octahedral, 16 bits each of x (low) and y; NULL where the mesh has none */
  uint8_t *triangles;  /* of a cluster: 3 * triangle on, all first corners, all second, all third, padded likewise */
  size_t bytes;
  uint64_t serial; /* of no other */
  int refined;     /* how often it was put in order after it was made: levels of detail added */
  struct tc_refining *refining; /* what is made for that beside; NULL: nothing. The owner's */
} tc_clusters;

/* Triangles with two corners in one place, and those with a vertex that is no finite number, are left out. Parallel over the pool, whose
 * halt ends it (TC_ERROR_CANCELLED, _PAUSED); TC_ERROR_MEMORY. share: is told how far it is; may be NULL. */
tc_clusters *tc_clusters_make(const tc_mesh *mesh, tc_pool *pool, const tc_share *share, GError **error);
/* Takes over `more`, of one part, the same origin, and likewise with or without normals; *all NULL: as the first.
 * TC_ERROR_MEMORY, TC_ERROR_LIMIT: *all is as it was, `more` gone. */
bool tc_clusters_add(tc_clusters **all, tc_clusters *more, const tc_mesh_source *of, GError **error);
/* Of no triangle and no part, at the same origin and with or without normals, to be appended to. TC_ERROR_MEMORY. */
tc_clusters *tc_clusters_none(const tc_clusters *like, GError **error);
/* Copies clusters as they are behind those that are there, and takes a new serial. TC_ERROR_MEMORY, TC_ERROR_LIMIT: it is
 * as it was. */
bool tc_clusters_append(tc_clusters *to, const tc_clusters *more, GError **error);
/* A copy of one part, in full. TC_ERROR_MEMORY. */
tc_clusters *tc_clusters_copy_part(const tc_clusters *all, size_t part, GError **error);
void tc_clusters_free(tc_clusters *clusters); /* NULL is fine */

/* Triangles of the full surfaces. */
static inline size_t tc_clusters_in_full(const tc_clusters *c) {
  size_t n = c->n_groups ? 0 : c->n_triangles;
  for (size_t i = 0; i < c->n_groups; i++) n += c->groups[i].triangles[0];
  return n;
}

/* Places in a cluster's arrays are padded to this. */
static inline size_t tc_cluster_padded(size_t n) { return (n + TC_CLUSTER_PAD - 1) / TC_CLUSTER_PAD * TC_CLUSTER_PAD; }

#endif
