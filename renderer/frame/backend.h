/* The interface of a back end: private to the renderer. */
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
#include "renderer/raycast/isosurface.h"
#include "renderer/skip/bounds.h"
#include "renderer/skip/boxes.h"
#include "renderer/skip/fine.h"
#include "renderer/skip/skip.h"
#include "renderer/splat/splats.h"
#include "renderer/tomocast.h"

/* The resources of a plan by number or by name, in the order of tc_resource. NULL: not in the plan, or not built
 * yet. */
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

/* The work of one frame. All inputs are validated; resources are built and live until render() returns. */
typedef struct tc_frame_job {
  const tc_plan *plan;
  tc_plan_key key; /* the key that runs: the plan's, or unskipped if too little is empty */
  const tc_scene *scene;
  const tc_volume *volume; /* the sampled field: the scene's volume, or its B-spline coefficients */
  const tc_volume *source; /* the scene's volume */
  const tc_rays *rays;
  tc_resource_set have;
  bool mesh_in_view;   /* of a plan with a mesh: tc_mesh_in_view() */
  bool outlines_table; /* have.table may be an outline: the back end computes the entries */
  struct tc_mesh *const *meshes; /* as in tc_render_request; NULL: the job is only explained */
  const tc_volume *label_volume; /* the checked volume of scene.labels, or the volume's gaps; read if have.labels is set */
  const tc_halt *halt; /* NULL: never interrupted */
  struct tc_building *building; /* as in tc_render_request */
  double pixel_samples; /* upper bound of the samples of one pixel (tc_estimate_samples()); 0: unknown */
  const char *isa; /* instruction set of the cpu back end, if the CPU draws or rasterises */
  const float (*spans)[2]; /* [frame's height][width]: start and end of each ray, mm from the eye; NULL: whole rays */
  const tc_ledger *ledger; /* accounts for memory beyond the frame's buffers; NULL: unbounded */
  bool want_linear;
  bool forward; /* as in tc_render_request */
  tc_frame *frame; /* width, height and buffers are set; render() fills stats.samples and .rays and adds to .tables_ms */
} tc_frame_job;

typedef struct tc_backend_ops {
  const char *name;
  bool maps_distance; /* dvr reads have.distance_map; false: have.boxes */
  void *(*create)(const tc_renderer_options *options, tc_pool *pool, GError **error);
  void (*destroy)(void *instance);
  const char *(*device)(void *instance); /* static, or owned by the instance */
  const char *(*isa)(void *instance);      /* instruction set */
  const char *(*variants)(void *instance); /* of its kernels, for people: "avx512", "avx512; avx2 for distant rays" */
  bool (*render)(void *instance, const tc_frame_job *job, GError **error);
  /* Shortest possible time between two checks of the halt at pixel_samples (job.pixel_samples) samples per pixel; if it
   * is too long, the cpu back end draws the frame. NULL: always short. */
  double (*deaf_ms)(void *instance, double pixel_samples);
  /* False: a program is still being compiled or a volume uploaded, both on another thread; the cpu back end draws frames
   * that must not wait. NULL: always ready. */
  bool (*ready)(void *instance, const tc_frame_job *job);
  /* For modes of tc_drawers: a clause that says why the cpu draws this scene instead. NULL: the back end draws it. */
  const char *(*refuses)(void *instance, const tc_scene *scene);
  /* True if the back end computes the entries of such a table from its outline (classify/outline.h) and adds the time
   * to stats.tables_ms. *why: which processor builds the table and the reason, for the plan. NULL: the CPU builds every
   * table, and the plan does not mention it. */
  bool (*builds_table)(void *instance, const tc_table_params *params, const char **why);
  /* Drops copies of a volume (by serial). */
  void (*forget)(void *instance, uint64_t volume_serial);
  /* Suffix of the name of the variant that draws a frame of this key and these rays: "avx512", "gl". */
  const char *(*kernel_suffix)(void *instance, const tc_plan_key *key, const tc_rays *rays);
} tc_backend_ops;

/* Draws a mode that casts no rays on the pool's threads, instead of the cpu back end. Contract as for render(). Table
 * entry NULL: the mode casts rays. */
typedef bool (*tc_drawer)(tc_pool *pool, const tc_frame_job *job, GError **error);
extern const tc_drawer tc_drawers[TC_MODE_COUNT];
/* Modes dvr and mip with surfaces in the volume (tc_mesh_is_within()): the pool rasterises the surfaces, a back end's
 * instance casts the rays. */
bool tc_mesh_within_draw(tc_pool *pool, const tc_backend_ops *ops, void *instance, const tc_frame_job *job, GError **error);
bool tc_mesh_frame_draw(tc_pool *pool, const tc_frame_job *job, GError **error); /* mode mesh */

extern const tc_backend_ops tc_cpu_backend;
extern const tc_backend_ops tc_gl_backend;

/* True if a working OpenGL was found. *hardware: it runs on a GPU, so `auto` should choose it. why: one sentence in
 * `size` bytes. Call before any context exists, on the thread that will own the context. */
bool tc_gl_probe(bool *hardware, char *why, size_t size);

/* The scene's window in single precision, for modes without a table. node = (voxel - lo) * sign, clamped to [0, last]:
 * increases with the value, at a voxel's full precision. grey = (node - center) * gain + 0.5, clamped to [0, 1]. */
typedef struct tc_slice_window {
  float lo, sign, last, center, gain;
} tc_slice_window;
void tc_slice_window_init(tc_slice_window *window, const tc_volume *volume, const tc_scene *scene);

/* The last step of a frame: composites premultiplied colour and opacity (compositing space) over the background, and
 * converts to sRGB in 8 bits (round to nearest), one row of `count` pixels per call. Shared by both back ends, so that
 * they agree. */
typedef struct tc_resolve {
  float background[3]; /* in the compositing space */
  bool transparent, linear_light;
} tc_resolve;
/* True if the scene's colours composite in linear light. */
bool tc_resolve_is_linear(const tc_scene *scene);
void tc_resolve_init(tc_resolve *resolve, const tc_scene *scene);
void tc_resolve_row(const tc_resolve *resolve, const float *linear, uint8_t *rgba, int count);
/* Table from sRGB i / TC_LIGHT_STEPS to linear light, [TC_LIGHT_STEPS + 2]; static. A projection's greys are display
 * values: if the scene composites in linear light, each ray's grey is decoded before rays are averaged. */
const float *tc_resolve_light(void);

#endif
