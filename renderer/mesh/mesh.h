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
#include "renderer/skip/skip.h"
#include "renderer/volume/volume.h"

typedef struct tc_mesh {
  double origin[3]; /* LPS mm; positions are relative to it */
  size_t n_vertices, n_triangles;
  float (*positions)[3];    /* [n_vertices], mm along LPS axes */
  float (*normals)[3];      /* [n_vertices], unit; NULL where there are none */
  uint32_t *colors;         /* [n_vertices], sRGB: red in the lowest byte, then green, blue; NULL where there are none */
  uint32_t (*triangles)[3]; /* [n_triangles] vertex numbers, counter-clockwise seen from where normals point to */
  bool ordered;             /* successive triangles are near each other; all vertices are finite, no triangle is degenerate */
  bool boxed;               /* low and high are the triangles' box: tc_mesh_measure() was called (measure.h) */
  float low[3], high[3];    /* relative to the origin */
  size_t bytes;             /* of the arrays */
  uint64_t serial;          /* unique in the process; keys caches */
  int references;           /* tc_mesh_ref() and tc_mesh_free() count them */
  void (*freed)(void *user); /* NULL, or called after the last one is dropped, on that thread */
  void *freed_user;
} tc_mesh;

/* Allocates a mesh without filling it. TC_ERROR_LIMIT above 2^32 - 1 vertices or triangles, TC_ERROR_MEMORY. */
tc_mesh *tc_mesh_new(size_t n_vertices, size_t n_triangles, bool normals, GError **error);
/* Allocates the colours of a mesh that has none. TC_ERROR_MEMORY. */
bool tc_mesh_add_colors(tc_mesh *mesh, GError **error);
/* Removes vertices that no triangle uses, of a mesh without colours; the arrays keep their size. TC_ERROR_MEMORY. */
bool tc_mesh_drop_unused(tc_mesh *mesh, GError **error);
tc_mesh *tc_mesh_ref(tc_mesh *mesh);
void tc_mesh_free(tc_mesh *mesh); /* drops a reference; NULL is fine */

/* Bytes of a mesh of this size without colours; colours take TC_MESH_COLOR_BYTES a vertex. */
enum { TC_MESH_COLOR_BYTES = 4 };
uint64_t tc_mesh_bytes(size_t n_vertices, size_t n_triangles, bool normals);

typedef struct tc_mesh_options {
  bool normals;       /* from the field's gradient, in mm */
  uint64_t max_bytes; /* limit on the mesh's size: TC_ERROR_LIMIT, with the number of triangles, above it; 0 = no limit */
  const tc_minmax *blocks; /* complete, of the volume; voxels of blocks without the value are not read. NULL: all are */
  tc_pool *pool;      /* NULL: runs on the caller. The pool's halt ends the extraction (TC_ERROR_CANCELLED or _PAUSED) */
  tc_share share;     /* reports progress */
} tc_mesh_options;

/* Extracts the surface where the trilinear field has the value `iso` (in the volume's unit). Values of at least `iso` are
 * inside; normals point outwards. Vertices lie on edges between voxel centres, along which the field is linear.
 *
 * In a cell the surface's polygons meet the cell's faces along lines that depend on the face's four voxels alone. A
 * face with two opposite corners inside is ambiguous: there the sign of the bilinear field's saddle decides (Nielson
 * and Hamann, The asymptotic decider, IEEE Visualization 1991), as in the trilinear field itself. No triangle has an
 * edge across such a face, so that every edge within the volume belongs to two triangles and the surface is a manifold,
 * open only at the volume's faces. Vertices keep a distance of 1/1024 of an edge from voxel centres, so that no triangle is
 * degenerate even if voxels have exactly the value `iso`.
 *
 * Vertices are numbered by row and kind of edge, so that a number follows from counting bits and rows can be
 * processed in any order, as in flying edges (Schroeder, Maynard and Geveci, LDAV 2015); triangles by bricks of cells
 * (bricks.h). The mesh does not depend on the number of threads. A value that does not occur gives a mesh without triangles. */
tc_mesh *tc_mesh_extract(const tc_volume *volume, double iso, const tc_mesh_options *options, GError **error);

/* Bounding box of each label of an integer volume (others: TC_ERROR_INVALID), found in one pass. */
typedef struct tc_label_boxes {
  int n_values;   /* 256 or 65536: number of bit patterns of a voxel */
  int reach[][6]; /* [n_values]: dims - first, then last + 1, along each axis; 0: the label does not occur */
} tc_label_boxes;
/* The halt of the pool (NULL: on the caller) ends it (TC_ERROR_CANCELLED, _PAUSED). Freed by g_free(). */
tc_label_boxes *tc_label_boxes_find(const tc_volume *labels, tc_pool *pool, GError **error);

/* Extracts the smooth surface of one label of an integer volume (others: TC_ERROR_INVALID): the zero set of the smoothed
 * signed distance to the label's boundary. Centres of the label's voxels stay inside and those of all other voxels outside, so that
 * thin parts survive and gaps stay open. Where slices are more than twice as far apart as pixels, the surface is interpolated
 * between their outlines, and leaves them by at most a quarter of the distance of slices and two pixels. The surface is
 * closed, at the volume's faces too. A label that does not occur gives a mesh without triangles. boxes: those of the
 * volume; NULL: computed. */
tc_mesh *tc_mesh_extract_label(const tc_volume *labels, uint32_t label, const tc_label_boxes *boxes,
                               const tc_mesh_options *options, GError **error);

/* The polygon in which a plane (LPS: unit normal . p + plane[3] = 0) cuts the box of the voxel centres. */
tc_mesh *tc_mesh_of_plane(const tc_volume *volume, const double plane[4], GError **error);

/* Joins meshes into one with the origin of the first. The result has normals if all have them, and colours if any has
 * (white for the others). TC_ERROR_LIMIT, TC_ERROR_MEMORY. */
tc_mesh *tc_mesh_join(tc_mesh *const *of, size_t n, GError **error);

/* Simplifies a mesh, flattest places first, until the next step would move the surface by more than about `error_mm` (quadric
 * error: Garland and Heckbert, SIGGRAPH 1997; meshoptimizer), or `least` triangles are left. Remaining vertices keep position,
 * normal and colour; differences in colour do not prevent a step. A closed manifold stays one, of the same genus but for parts
 * that vanish. Runs on the caller without interruption: 0.6 s for a million triangles (AMD EPYC), two to seven times that
 * where many necks are narrow. */
tc_mesh *tc_mesh_simplify(const tc_mesh *mesh, double error_mm, size_t least, GError **error);

#endif
