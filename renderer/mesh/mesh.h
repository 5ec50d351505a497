/* Triangle meshes in patient space, and the extraction of isosurfaces from volumes.
 *
 * A mesh is plain data: its vertices are shared by the triangles around them, positions are single precision relative
 * to an origin in double precision, so that nothing is lost far from the patient's origin. Immutable once made; any
 * thread may read it. */
#ifndef TC_MESH_H
#define TC_MESH_H

#include <stddef.h>
#include <stdint.h>

#include "renderer/base/building.h"
#include "renderer/base/error.h"
#include "renderer/base/pool.h"
#include "renderer/volume/volume.h"

typedef struct tc_mesh {
  double origin[3]; /* LPS mm; positions are relative to it */
  size_t n_vertices, n_triangles;
  float (*positions)[3];    /* [n_vertices], mm along LPS axes */
  float (*normals)[3];      /* [n_vertices], unit; NULL where there are none */
  uint32_t *colors;         /* [n_vertices], sRGB: red in the lowest byte, then green, blue; NULL where there are none */
  uint32_t (*triangles)[3]; /* [n_triangles] vertex numbers, counter-clockwise seen from where normals point to */
  size_t bytes;             /* of the arrays */
  uint64_t serial;          /* unique in the process; keys caches */
  int references;           /* tc_mesh_ref() and tc_mesh_free() count them */
  void (*freed)(void *user); /* NULL, or called after the last one is dropped, on that thread */
  void *freed_user;
} tc_mesh;

/* An empty mesh for so many; TC_ERROR_LIMIT over 2^32 - 1 of either, TC_ERROR_MEMORY. */
tc_mesh *tc_mesh_new(size_t n_vertices, size_t n_triangles, bool normals, GError **error);
/* Room for colours of a mesh without. TC_ERROR_MEMORY. */
bool tc_mesh_add_colors(tc_mesh *mesh, GError **error);
tc_mesh *tc_mesh_ref(tc_mesh *mesh);
void tc_mesh_free(tc_mesh *mesh); /* drops a reference; NULL is fine */

/* Allocates n + 1 items, in huge pages where the system has them (page faults of small pages cost a tenth of an extraction).
 * NULL: no memory; freed by free(). */
void *tc_mesh_reserve(size_t n, size_t size);

/* Bytes of such a mesh without colours, which take TC_MESH_COLOR_BYTES a vertex. */
enum { TC_MESH_COLOR_BYTES = 4 };
uint64_t tc_mesh_bytes(size_t n_vertices, size_t n_triangles, bool normals);

typedef struct tc_mesh_options {
  bool normals;       /* from the field's gradient, in mm */
  uint64_t max_bytes; /* of the mesh: larger ones are TC_ERROR_LIMIT, which tells the triangles; 0 = no limit */
  tc_pool *pool;      /* NULL: on the caller. Its halt ends the extraction (TC_ERROR_CANCELLED or _PAUSED) */
  tc_share share;     /* reports progress */
} tc_mesh_options;

/* The surface where the trilinear field has the value `iso` (in the volume's unit); what has at least that value is
 * inside, and normals point out of it. Vertices lie on edges between voxel centres, where the field is linear.
 *
 * In a cell the surface's polygons meet the cell's faces along lines that depend on the face's four voxels alone. A
 * face with two opposite corners inside is ambiguous: there the sign of the bilinear field's saddle decides (Nielson
 * and Hamann, The asymptotic decider, IEEE Visualization 1991), as in the trilinear field itself. No triangle has an
 * edge across such a face, so that every edge within the volume belongs to two triangles and the surface is a manifold,
 * which ends at the volume's faces only. No vertex is nearer than 1/1024 of an edge to a voxel's centre: no triangle is
 * degenerate, however many voxels have exactly the value.
 *
 * Vertices are numbered by plane, row and kind of edge, so that a number follows from counting bits and rows can be
 * worked on in any order, in the manner of flying edges (Schroeder, Maynard and Geveci, LDAV 2015). The same mesh comes
 * from any number of threads. Not found anywhere: a mesh of no triangles. */
tc_mesh *tc_mesh_extract(const tc_volume *volume, double iso, const tc_mesh_options *options, GError **error);

/* The bounding box of each label of a volume of whole numbers (else TC_ERROR_INVALID), found in one pass. */
typedef struct tc_label_boxes {
  int n_values;   /* 256 or 65536: of a voxel's bits */
  int reach[][6]; /* [n_values]: dims - first, then last + 1, along each axis; 0: nowhere */
} tc_label_boxes;
/* The halt of the pool (NULL: on the caller) ends it (TC_ERROR_CANCELLED, _PAUSED). Freed by g_free(). */
tc_label_boxes *tc_label_boxes_find(const tc_volume *labels, tc_pool *pool, GError **error);

/* The smooth surface of one label of a volume of whole numbers (else TC_ERROR_INVALID): where the smoothed signed
 * distance to the label's boundary is 0; where slices lie far apart, interpolated between their outlines. The centre of
 * every voxel of the label stays inside and that of every other voxel outside, so that nothing thin is lost and no gap
 * is closed. Closed, at the volume's faces too. A label of no voxel: a mesh of no triangles. boxes:
 * of the volume; NULL: looked for. */
tc_mesh *tc_mesh_extract_label(const tc_volume *labels, uint32_t label, const tc_label_boxes *boxes,
                               const tc_mesh_options *options, GError **error);

/* The part of a plane (LPS: unit normal . p + plane[3] = 0) within the box of the voxels' centres. */
tc_mesh *tc_mesh_of_plane(const tc_volume *volume, const double plane[4], GError **error);

/* All of them in one, with the origin of the first; normals where all have them, colours where any has (white in others).
 * TC_ERROR_LIMIT, TC_ERROR_MEMORY. */
tc_mesh *tc_mesh_join(tc_mesh *const *of, size_t n, GError **error);

/* Takes away triangles, the flattest places first, until the next one would move the surface by more than about
 * `error_mm` (a quadric's distance: Garland and Heckbert, SIGGRAPH 1997; meshoptimizer), or `least` triangles are left.
 * Vertices that remain keep their place, normal and colour; colours do not hold triangles back. On the caller, in one piece: 0.6 s for a million triangles (AMD EPYC). */
tc_mesh *tc_mesh_simplify(const tc_mesh *mesh, double error_mm, size_t least, GError **error);

#endif
