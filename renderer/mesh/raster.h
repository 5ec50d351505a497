/* The rasteriser: triangles of a mesh to pixels, each of which is shaded once.
 *
 * Clusters (clusters.h) outside the picture, facing away, or cut off are left out; the rest are sorted into the tiles
 * they may touch. A tile draws its clusters, nearest first, into a visibility buffer of its own: for every sample the
 * nearness and the number of the triangle that is nearest (deferred shading: Knigavko and Avrunin; Burns and Hunt, The
 * visibility buffer, JCGT 2013). Clusters behind all that is there already (hierarchical depth, blocks of 8 x 8 pixels)
 * are left out before any of their vertices is transformed. Then the tile's visible triangles are looked up, once a
 * pixel and triangle: barycentric weights are computed anew where the ray meets the triangle, attributes fetched, colours
 * computed and averaged over the pixel's samples. Tiles need nothing of each other; every phase is parallel.
 *
 * Translucent surfaces are drawn after the opaque ones of a tile, and all that is before those is kept, as triangle and
 * nearness of each sample, and sorted for each pixel (Carpenter, The A-buffer, SIGGRAPH 1984): exact for any number of
 * layers. Opacities alone tell what share of a pixel each layer has, so that what is covered up is never shaded.
 *
 * Vertices are rounded to a 256th of a pixel; coverage is decided by whole numbers and the top-left rule, so that a
 * sample on an edge or in a corner belongs to one of the triangles there and no sample between triangles is missed. The
 * picture does not depend on the number of threads, nor on the instruction set. */
#ifndef TC_MESH_RASTER_H
#define TC_MESH_RASTER_H

#include "renderer/base/ledger.h"
#include "renderer/mesh/view.h"

enum { TC_RASTER_SIDE = 64, TC_RASTER_SAMPLES = 64 };

typedef struct tc_raster_surface {
  float color[3]; /* compositing space */
  float opacity;
  bool one_sided; /* backs are not drawn: changes nothing of a closed opaque one that is looked at from outside and not cut */
  bool textured;  /* its colours are the job's texture's, and not lit */
  int look;       /* of the job's */
  bool colored;   /* its colours are its vertices', of a part that has them */
} tc_raster_surface;

/* How surfaces are lit, in the numbers of raycast/shading.h (its weight w is 1). */
typedef struct tc_raster_look {
  bool shaded;
  int n_lights;
  float factor[2], glow[2][3], least, specular, shininess;
  struct {
    bool at_camera;
    float to[3]; /* unit, along the view's right, down, forward */
    float color[3]; /* of any brightness */
  } lights[TC_MAX_LIGHTS];
} tc_raster_look;

/* What is seen of a surface in a pixel. */
typedef struct tc_raster_seen {
  int pixel; /* y * TC_RASTER_SIDE + x, of what is emitted */
  float color[3], opacity, depth;
} tc_raster_seen;

/* Pixels [y0, y1) x [x0, x1) of one tile: premultiplied colour and opacity, and mm from the eye (INFINITY: nothing). */
typedef struct tc_raster_picture {
  int tile, x0, y0, x1, y1;
  int rows; /* of the tile that are finished with these, from its top on; TC_RASTER_SIDE: all */
  const float (*linear)[4]; /* [y1 - y0][TC_RASTER_SIDE] */
  const float *depth;       /* likewise */
  const tc_raster_seen *seen; /* [n_seen], of a layered job: pixel by pixel, the nearest first */
  size_t n_seen;
} tc_raster_picture;

typedef struct tc_raster_counts {
  uint64_t outside, facing_away; /* clusters left out for all tiles ... */
  uint64_t hidden, drawn;        /* ... and for one; a cluster counts in every tile it may touch */
  uint64_t triangles;            /* looked at in a tile */
  uint64_t covered;              /* samples covered by triangles, hidden or not */
  uint64_t layers;               /* samples covered by translucent triangles before what is opaque */
  uint64_t shaded;               /* pairs of a pixel and a triangle that is seen in it ... */
  uint64_t colored;              /* ... for which the colours of vertices were looked up */
} tc_raster_counts;

typedef struct tc_raster_kernels tc_raster_kernels;
/* "scalar", "avx2", "avx512"; NULL where there is no such. The caller asks the processor first. */
const tc_raster_kernels *tc_raster_kernels_named(const char *isa);

typedef struct tc_raster_job {
  const tc_clusters *mesh;
  const tc_mesh_view *view;
  const tc_raster_kernels *kernels;
  const tc_raster_look *looks; /* [n_looks], at least one */
  int n_looks;
  const tc_raster_surface *surfaces; /* [mesh->n_parts] */
  const float *channels;     /* [256] the compositing space's number for each of a vertex colour's; NULL: no surface is colored */
  const uint8_t *levels;     /* [mesh->n_groups]: of detail, levels.h; NULL: all in full */
  void (*texture)(const void *texture_user, const double at[3], float color[3]); /* mm from the mesh's origin; any thread */
  const void *texture_user;
  int n_samples;             /* of a pixel, up to TC_RASTER_SAMPLES */
  const double (*samples)[2]; /* pixels from a pixel's middle, within -0.5 .. 0.5; rounded to a 256th */
  bool forward;              /* for measurements: clusters in the mesh's order, none left out as hidden, shaded where they
                                are the nearest so far; of opaque surfaces and one sample */
  const tc_ledger *ledger;   /* of the memory of translucent layers; NULL: no bound */
  bool layered;              /* what is seen is emitted one by one beside the sum; of one sample */
  const uint8_t *finished;   /* [tiles], row by row: how many rows of each, from its top on, are not drawn again; NULL: none */
  /* Once a tile that it comes further in, from any thread of the pool. False: enough, the rest is left as the halt leaves it. */
  bool (*emit)(void *user, const tc_raster_picture *picture);
  void *user;
  tc_pool *pool;             /* its halt leaves tiles, or their lower rows, undrawn: not emitted */
} tc_raster_job;

/* False: stopped (TC_ERROR_CANCELLED, _PAUSED) or TC_ERROR_MEMORY; what was emitted holds. counts are added to. */
bool tc_raster_draw(const tc_raster_job *job, tc_raster_counts *counts, GError **error);

#endif
