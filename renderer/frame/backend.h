/* What a back end fills: private to the renderer. */
#ifndef TC_RENDERER_BACKEND_H
#define TC_RENDERER_BACKEND_H

#include "renderer/classify/integrals.h"
#include "renderer/classify/labels.h"
#include "renderer/skip/distance_map.h"
#include "renderer/base/halt.h"
#include "renderer/mesh/clusters.h"
#include "renderer/base/pool.h"
#include "renderer/raycast/projection.h"
#include "renderer/raycast/rays.h"
#include "renderer/raycast/surface.h"
#include "renderer/skip/bounds.h"
#include "renderer/skip/boxes.h"
#include "renderer/skip/fine.h"
#include "renderer/skip/skip.h"
#include "renderer/splat/splats.h"
#include "renderer/tomocast.h"

/* What a plan lists, by name or by number: in the order of tc_resource. NULL: not listed, or not there yet. */
typedef union tc_resource_set {
  const void *of[TC_RESOURCE_COUNT];
  struct {
    const tc_volume *coefficients;
    const tc_table *table; /* without entries for a back end that builds_table() */
    const tc_integrals *integrals;
    const tc_support *support;
    const tc_minmax *minmax;
    const tc_distance_map *distance_map;
    const tc_fine *fine;
    const tc_boxes *boxes;
    const tc_bounds *bounds;
    const tc_labels *labels;
    const tc_clusters *mesh;
    const tc_vmd *model;
    const tc_splats *splats, *cut;
  };
} tc_resource_set;

/* One frame's work: everything was validated, every resource is built and lives until render() returns. */
typedef struct tc_frame_job {
  const tc_plan *plan;
  tc_plan_key key; /* what runs: the plan's, or unskipped where the frame found nothing to skip */
  const tc_scene *scene;
  const tc_volume *volume; /* what is sampled: the scene's volume, or its B-spline coefficients in its place */
  const tc_volume *source; /* the scene's volume */
  const tc_rays *rays;
  tc_resource_set have;
  bool outlines_table; /* have.table may be without entries: the back end makes them */
  struct tc_mesh *const *meshes; /* of scene.mesh.surfaces, by their places; NULL: only to be explained */
  const tc_volume *label_volume; /* what scene.labels names, checked, or the volume's gaps; read if there are have.labels */
  const tc_halt *halt; /* may be NULL: nobody interrupts */
  struct tc_building *building; /* is told what is built; may be NULL */
  double pixel_samples; /* of its rays, from above, as tc_estimate_samples() counts them; 0: unknown */
  const char *isa; /* instruction set of the cpu back end, where the cpu draws */
  const float (*spans)[2]; /* [frame's height][width]: the cpu casts rays between these, mm from the eye; NULL: whole ones */
  uint64_t spare_bytes; /* of memory that drawing may take beside the frame's buffers */
  bool want_linear;
  bool forward; /* as in tc_render_request */
  tc_frame *frame; /* width, height set; buffers allocated; stats.samples, .rays to be filled, .tables_ms added to */
} tc_frame_job;

typedef struct tc_backend_ops {
  const char *name;
  bool maps_distance; /* reads have.distance_map in dvr as well; else have.boxes */
  /* device: static or owned by the instance. */
  void *(*create)(const tc_renderer_options *options, tc_pool *pool, GError **error);
  void (*destroy)(void *instance);
  const char *(*device)(void *instance);
  const char *(*isa)(void *instance);
  bool (*render)(void *instance, const tc_frame_job *job, GError **error);
  /* How long it would be without a look at the halt, at least, for pixels of so many samples (job.pixel_samples): a frame
   * for which that is long is the cpu back end's. NULL: it looks whenever it should. */
  double (*deaf_ms)(void *instance, double pixel_samples);
  /* False: this job would wait for a program to be compiled or a volume to be uploaded. That has begun beside, and what
   * must not wait is drawn by the cpu back end meanwhile. NULL: nothing ever waits. */
  bool (*ready)(void *instance, const tc_frame_job *job);
  /* Why it does not draw scenes of this kind in a mode of tc_drawers, a clause; the cpu does. NULL: it draws this one. */
  const char *(*refuses)(void *instance, const tc_scene *scene);
  /* Whether the back end makes the entries of such a table itself, from its outline (classify/outline.h), adding the
   * time it takes to stats.tables_ms. *why: who builds it and the reason, for the plan. NULL: the cpu builds all, and
   * the plan has nothing to say about it. */
  bool (*builds_table)(void *instance, const tc_table_params *params, const char **why);
  /* Drops copies of a volume (by serial). */
  void (*forget)(void *instance, uint64_t volume_serial);
  /* What the variants' names end with: "avx512", "gl". */
  const char *(*kernel_suffix)(void *instance);
} tc_backend_ops;

/* Who draws a mode that casts no rays, on the pool, in the cpu back end's place; NULL: the back end. Like render() above. */
typedef bool (*tc_drawer)(tc_pool *pool, const tc_frame_job *job, GError **error);
extern const tc_drawer tc_drawers[TC_MODE_COUNT];
/* dvr and mip with surfaces in them (tc_mesh_is_within()): cpu is the cpu back end's instance. */
bool tc_mesh_within_draw(tc_pool *pool, void *cpu, const tc_frame_job *job, GError **error);
bool tc_mesh_frame_draw(tc_pool *pool, const tc_frame_job *job, GError **error); /* mode mesh */

extern const tc_backend_ops tc_cpu_backend;
extern const tc_backend_ops tc_gl_backend;

/* Is there a GL device worth taking on "auto"? *why: one sentence in `size` bytes. Callable before any context exists,
 * on the thread that will own it. */
bool tc_gl_probe(bool *hardware, char *why, size_t size);

/* From voxels to grey in single precision, for modes without a table: node = (voxel - lo) * sign, clamped to [0, last],
 * grows with the value and loses nothing of a voxel; grey = (node - center) * gain + 0.5, clamped to [0, 1], is the
 * scene's window. */
typedef struct tc_slice_window {
  float lo, sign, last, center, gain;
} tc_slice_window;
void tc_slice_window_init(tc_slice_window *window, const tc_volume *volume, const tc_scene *scene);

/* Premultiplied colour in the compositing space + opacity -> background behind it, sRGB, 8 bits (round to nearest).
 * Shared by both back ends so that they agree: row of `count` pixels. lut: tc_resolve_init(). */
typedef struct tc_resolve {
  float background[3]; /* in the compositing space */
  bool transparent, linear_light;
} tc_resolve;
/* Whether a scene's colours composite in linear light. */
bool tc_resolve_is_linear(const tc_scene *scene);
void tc_resolve_init(tc_resolve *resolve, const tc_scene *scene);
void tc_resolve_row(const tc_resolve *resolve, const float *linear, uint8_t *rgba, int count);
/* Greys of a projection are display values; a scene that composites in linear light has each ray's decoded, before the
 * mean of several. sRGB i / TC_LIGHT_STEPS -> linear light, [TC_LIGHT_STEPS + 2]; static. */
const float *tc_resolve_light(void);

#endif
