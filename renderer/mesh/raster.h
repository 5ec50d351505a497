/* The rasteriser: draws the triangles of a mesh and shades each visible pixel once.
 *
 * Clusters (clusters.h) are culled if they are outside the view, back-facing or clipped; the rest are binned into the tiles
 * they may touch. A tile draws its clusters, nearest first, into its own visibility buffer, which holds nearness and number
 * of the nearest triangle for every sample (deferred shading: Knigavko and Avrunin; Burns and Hunt, The visibility
 * buffer, JCGT 2013). Clusters behind the buffer's contents (hierarchical depth, blocks of 8 x 8 pixels) are culled before
 * any of their vertices is transformed. Shading then visits each pair of pixel and visible triangle once: it recomputes the
 * barycentric weights where the ray meets the triangle, fetches the attributes, computes the colour, and averages over the
 * pixel's samples. Tiles are independent of each other; every phase is parallel.
 *
 * Translucent surfaces are drawn after the opaque surfaces of a tile. Their fragments in front of the opaque ones are kept
 * (triangle and nearness of each sample) and sorted for each pixel (Carpenter, The A-buffer, SIGGRAPH 1984): exact for any
 * number of layers. Each layer's share of a pixel follows from the opacities alone, so that hidden layers are never shaded.
 * A triangle that is the first layer of one sample and the second of another is shaded once for each.
 *
 * Vertices are rounded to a 256th of a pixel. Coverage is decided in integers with the top-left rule, so that a sample on
 * an edge or a corner belongs to exactly one triangle and no sample between triangles is missed. The picture depends
 * neither on the number of threads nor on the instruction set. */
#ifndef TC_MESH_RASTER_H
#define TC_MESH_RASTER_H

#include "renderer/base/ledger.h"
#include "renderer/mesh/view.h"

enum { TC_RASTER_SIDE = 64, TC_RASTER_SAMPLES = 64 };

typedef struct tc_raster_surface {
  float color[3]; /* compositing space */
  float opacity;
  bool one_sided; /* back faces are not drawn; makes no difference for a closed opaque surface seen from outside and not clipped */
  bool textured;  /* coloured by the job's texture, unlit */
  int look;       /* index into the job's looks */
  bool colored;   /* coloured by its vertices; the part has vertex colours */
} tc_raster_surface;

/* Lighting of a surface, in the terms of raycast/shading.h (with its weight w = 1). */
typedef struct tc_raster_look {
  bool shaded;
  int n_lights;
  float factor[2], glow[2][3], least, specular, shininess;
  struct {
    bool at_camera;
    float to[3]; /* unit, along the view's right, down, forward */
    float color[3]; /* times the light's intensity; may exceed 1 */
  } lights[TC_MAX_LIGHTS];
} tc_raster_look;

/* One visible layer of a pixel. */
typedef struct tc_raster_seen {
  int pixel; /* y * TC_RASTER_SIDE + x, relative to the emitted tile */
  float color[3], opacity, depth;
} tc_raster_seen;

/* Pixels [y0, y1) x [x0, x1) of one tile: premultiplied colour and opacity, and depth in mm from the eye (INFINITY: no surface). */
typedef struct tc_raster_picture {
  int tile, x0, y0, x1, y1;
  int rows; /* finished rows of the tile, counted from its top, including these; TC_RASTER_SIDE: all */
  const float (*linear)[4]; /* [y1 - y0][TC_RASTER_SIDE] */
  const float *depth;       /* likewise: of the nearest sample; of several samples only if want_depth */
  const tc_raster_seen *seen; /* [n_seen], only of a layered job: pixel by pixel, nearest layer first */
  size_t n_seen;
} tc_raster_picture;

typedef struct tc_raster_counts {
  uint64_t outside, facing_away; /* clusters culled for the whole picture */
  uint64_t hidden, drawn;        /* clusters culled by depth, and drawn: counted once for every tile that they may touch */
  uint64_t triangles;            /* triangles processed, counted once for every tile */
  uint64_t covered;              /* samples covered by triangles, hidden or not */
  uint64_t layers;               /* samples covered by translucent triangles in front of the opaque surfaces */
  uint64_t shaded;               /* pairs of a pixel and a visible triangle */
  uint64_t colored;              /* shaded pairs that fetched vertex colours */
} tc_raster_counts;

typedef struct tc_raster_kernels tc_raster_kernels;
/* isa: "scalar", "avx2" or "avx512"; NULL if unknown. The caller checks that the processor supports it. */
const tc_raster_kernels *tc_raster_kernels_named(const char *isa);

typedef struct tc_raster_job {
  const tc_clusters *mesh;
  const tc_mesh_view *view;
  const tc_raster_kernels *kernels;
  const tc_raster_look *looks; /* [n_looks], at least one */
  int n_looks;
  const tc_raster_surface *surfaces; /* [mesh->n_parts] */
  const float *channels;     /* [256] sRGB channel of a vertex colour to compositing space; NULL: no surface is colored */
  const uint8_t *levels;     /* [mesh->n_groups] level of detail of each group (levels.h); NULL: full detail */
  void (*texture)(const void *texture_user, const double at[3], float color[3]); /* at: mm from the mesh's origin; any thread */
  const void *texture_user;
  int n_samples;             /* samples of a pixel, up to TC_RASTER_SAMPLES */
  const double (*samples)[2]; /* offsets from the pixel's centre, -0.5 .. 0.5 pixels; rounded to a 256th */
  bool forward;              /* forward shading, for measurements: clusters in the mesh's order, no culling by depth, every
                                fragment shaded that is the nearest so far; opaque surfaces and one sample only */
  const tc_ledger *ledger;   /* accounts for the memory of translucent layers; NULL: no bound */
  bool want_depth;           /* fills depth, where a pixel has several samples */
  int layered;               /* also emits so many visible layers of each pixel (seen), the nearest; one sample only */
  const uint8_t *finished;   /* [tiles], row by row: rows of each tile, from its top, that are already drawn; NULL: none */
  /* Called from any thread of the pool, once for every tile that made progress. Returns false to stop, as the halt does. */
  bool (*emit)(void *user, const tc_raster_picture *picture);
  void *user;
  tc_pool *pool;             /* its halt leaves tiles, or their lower rows, undrawn; those are not emitted */
} tc_raster_job;

/* Returns false if stopped (TC_ERROR_CANCELLED, _PAUSED) or on TC_ERROR_MEMORY; emitted tiles stay valid. Adds to *counts. */
bool tc_raster_draw(const tc_raster_job *job, tc_raster_counts *counts, GError **error);

#endif
