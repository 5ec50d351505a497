/* Tomocast renderer: scene + volume -> plan -> frame. The one header the server needs.
 *
 * A tc_renderer owns a back end, its worker threads and its cached resources. tc_render() is called by
 * one thread at a time (the render thread, which for the gl back end owns the EGL context: create, use and
 * free it on that same thread). tc_plan_make() and everything about volumes and scenes may be called anywhere. */
#ifndef TC_TOMOCAST_H
#define TC_TOMOCAST_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "renderer/base/building.h"
#include "renderer/classify/labels.h"
#include "renderer/base/error.h"
#include "renderer/import/import.h"
#include "renderer/base/interrupt.h"
#include "renderer/base/ledger.h"
#include "renderer/plan/estimate.h"
#include "renderer/plan/explain.h"
#include "renderer/plan/plan.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/histogram.h"
#include "renderer/volume/volume.h"

typedef enum tc_backend { TC_BACKEND_AUTO, TC_BACKEND_CPU, TC_BACKEND_GL, TC_BACKEND_COUNT } tc_backend;

/* Which processor computes pre-integration tables for the gl back end; the entries agree within 1e-6. auto: the GPU, or
 * the CPU if OpenGL runs in software. The cpu back end always computes its tables on the CPU. */
typedef enum tc_table_builder { TC_TABLES_AUTO, TC_TABLES_CPU, TC_TABLES_GL } tc_table_builder;

typedef struct tc_renderer_options {
  tc_backend backend;
  int threads;          /* CPU workers; 0 = one per online core */
  const char *isa;      /* "scalar" "avx2" "avx512-load" "avx512-gather" "avx512"; NULL = the fastest here (raycast/cpu/isa.h) */
  uint64_t cache_bytes; /* budget of tables and other shared resources; 0 = 256 MiB */
  const tc_ledger *ledger; /* shared resources are reserved here; outlives the renderer. The resources of one frame may
                              exceed cache_bytes but not the ledger's budget (TC_ERROR_MEMORY). NULL: unbounded */
  tc_table_builder tables; /* for tests and measurements */
  bool levels;          /* builds levels of detail of large meshes on another thread, after a still frame at full
                           detail */
} tc_renderer_options;

typedef struct tc_renderer_info {
  const char *backend; /* "cpu" or "gl" */
  const char *why;     /* one sentence: why this back end was chosen */
  const char *device;  /* CPU model or GL renderer string */
  const char *isa;     /* SIMD level of the cpu back end, with the variant of its kernels */
  int threads;
} tc_renderer_info;

typedef struct tc_renderer tc_renderer;

tc_renderer *tc_renderer_new(const tc_renderer_options *options, GError **error);
void tc_renderer_free(tc_renderer *renderer); /* NULL is fine */
const tc_renderer_info *tc_renderer_about(const tc_renderer *renderer);

typedef struct tc_frame_stats {
  double coefficients_ms, tables_ms, skip_ms, render_ms; /* wall time of the stages */
  uint64_t samples;                     /* field samples taken */
  uint64_t gradients;                   /* gradients computed for shading; their voxel fetches do not count as
                                           samples */
  uint64_t rays;                        /* rays that met the volume */
  /* jumps over empty space, each by a packet (cpu) or by a ray (gl) */
  uint64_t leaps;
  uint64_t hidden; /* clusters of a mesh culled by depth, counted once for every tile; gl counts none */
  uint64_t shaded; /* pairs of a pixel and a triangle visible in it */
  uint64_t looked_at; /* vertices of uploaded meshes, to see whether a mesh is in the view */
  bool stand_in; /* the cpu back end drew in place of the gl back end: this time does not predict the next frame's */
} tc_frame_stats;

enum { TC_FRAME_LAYERS = 4 };

/* A finished picture. Zero-initialise before first use; buffers are reused by the next tc_render(). */
typedef struct tc_frame {
  int width, height;
  uint8_t *rgba;     /* [height][width][4], row 0 on top, sRGB; alpha straight (255 unless background is transparent) */
  float *linear;     /* [height][width][4], only on request: premultiplied colour in the compositing space and opacity,
                        without the background; for measurements */
  float *depth;      /* [height][width], only on request and in modes isosurface, mesh and splat: mm from the eye to the
                        surface along the pixel's ray (the nearest of several rays), infinite if no ray hits a
                        surface */
  float (*layers)[TC_FRAME_LAYERS]; /* [height][width], with depth where tc_frame_has_layers() and the cpu back end drew, else
                        NULL: mm from the eye to the first visible surfaces along the pixel's ray; infinite: no more */
  size_t capacity;   /* pixels allocated in rgba */
  size_t linear_capacity, depth_capacity;
  tc_frame_stats stats;
  struct tc_progress *progress; /* private to the renderer: state of a paused frame */
} tc_frame;

/* Finished share of a paused frame, 0..1; resuming does not draw this share again. */
double tc_frame_done(const tc_frame *frame);
/* Number of the latest consecutive calls for this paused frame that were paused before they made any progress. */
int tc_frame_fruitless(const tc_frame *frame);
/* Whether a frame of the scene shows several surfaces in a pixel, some through others, each at one depth: mode mesh with
 * translucent surfaces and one ray a pixel. */
bool tc_frame_has_layers(const tc_scene *scene);
/* Bytes needed to draw a frame of the scene, without the translucent layers of surfaces in a volume. measured: with the
 * outputs linear, depth and layers. */
uint64_t tc_frame_need(const tc_scene *scene, int width, int height, bool measured);
/* Bytes of the frame's buffers and of the state of a paused frame. */
uint64_t tc_frame_bytes(const tc_frame *frame);

/* Drops the state of a paused frame that will not be resumed; the buffers stay. */
void tc_frame_give_up(tc_frame *frame);
void tc_frame_finish(tc_frame *frame); /* frees the buffers; a zeroed frame is fine */

#define TC_MAX_TABLE_SIZE 4096

typedef struct tc_render_request {
  int width, height;          /* 0 = the scene's own; smaller while a user drags (the field of view stays the same) */
  bool want_linear;           /* fills frame->linear */
  bool want_depth;            /* fills frame->depth, in the modes that have a depth */
  const tc_interrupt *interrupt; /* ends the call with TC_ERROR_CANCELLED or TC_ERROR_PAUSED; may be NULL */
  tc_explanation *explanation; /* filled when the frame is finished: what was drawn and why, with the milliseconds and
                                  bytes of each stage; may be NULL */
  tc_building *building;      /* shows other threads which resource is being built; may be NULL */
  const tc_ledger *ledger;    /* reserves the layers of translucent surfaces, whose number is known only while drawing.
                                 The call does not return these bytes: when it ends, the caller releases all of them and
                                 accounts for the frame by tc_frame_bytes(). NULL: unbounded */
  /* Resumes a frame that ended with TC_ERROR_PAUSED. Volume, scene, request (but for the interrupt) and tc_frame must
   * be the same. Finished pixels are kept, stats continue to count (a ray that is cast again counts again), and the
   * picture equals an uninterrupted one to the last bit. A frame that was not paused is drawn from the start. */
  bool resume;
  const tc_volume *labels;    /* the volume that scene.labels.volume names, borrowed until tc_render() returns; NULL if
                                 the scene names none. The caller resolves ids; tc_render() runs tc_labels_check() */
  struct tc_mesh *const *meshes; /* [surfaces of scene.mesh]: the mesh of each surface that names one, else NULL; borrowed
                                 until tc_render() returns. NULL if no surface names a mesh */
  bool hurry;                 /* do not wait for the gl back end to compile a program or upload a large volume: the cpu
                                 back end draws this frame, equal within 1/255 (stats.stand_in) */
  bool prepare;               /* build what the frame reads, and draw nothing: its pixels are undefined */
  bool moving;                /* the user is changing the scene: surfaces may lose details smaller than a pixel, tables have
                                 at most 256 nodes a side */
  int coarser_levels;         /* of a moving scene: or than so many pixels, where that makes frames faster; 0 = 1 */
  int table_size,
      table_bits; /* for measurements: entries per side (2 to TC_MAX_TABLE_SIZE) and bits of an entry (8, or 16
                                 for half floats) of the pre-integration table; 0 = the plan's choice, single precision */
  bool forward;               /* for measurements: forward instead of deferred shading of opaque triangles, one sample a
                                 pixel (mesh/raster.h) */
  double pixel_share;         /* for measurements: a pixel's rays are spread over this share of the pixel's width, so
                                 that a small picture samples like a large one; 0 = 1, the whole pixel */
} tc_render_request;

/* Renders one frame. request may be NULL. After a failure the frame's content is undefined (except for TC_ERROR_PAUSED, see
 * resume) and the renderer remains usable. A scene with an unsupported feature fails with TC_ERROR_UNSUPPORTED and a
 * pointer to the member, instead of giving a wrong picture. A scene that still has a bound on error or time is refused:
 * quality/quality.h and quality/cost.h replace such a bound by sampling parameters. */
bool tc_render(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
               tc_frame *frame, GError **error);

/* Explains the frame that this renderer would draw with the resources it holds now, without drawing the scene. While
 * explanation->object_measured is false, each call for a solid object spends about 5 ms on measuring this machine's speed.
 * Reads labels and interrupt of the request, which may be NULL; a cancelled call omits the expected cost of the object.
 * Same thread rule as tc_render(). */
bool tc_renderer_explain(tc_renderer *renderer, const tc_volume *volume, const tc_scene *scene,
                         const tc_render_request *request, tc_explanation *explanation, GError **error);

/* The surface that a pixel of mode mesh shows. */
typedef struct tc_pick {
  double at[2];       /* input: the pixel position, see tc_renderer_pick() */
  bool found;
  double position[3]; /* LPS mm */
  double distance_mm; /* from the eye */
  double value;       /* iso value of the surface, or the volume's value on a slice; NaN for meshes and labels */
  int surface;        /* index in scene.mesh.surfaces; -1: the scene has no list */
  uint32_t label;     /* label of the surface; 0: not a label's surface */
} tc_pick;

/* Picks the surface at pixel position pick->at (x, y: the centre of pixel i is i + 0.5). Reads labels, meshes, width
 * and height of the request as tc_render() does. Uses the surfaces built for an earlier frame of the scene;
 * TC_ERROR_BUSY if they are not cached. Same thread rule as tc_render(). */
bool tc_renderer_pick(tc_renderer *renderer, const tc_volume *volume, const tc_scene *scene,
                      const tc_render_request *request, tc_pick *pick, GError **error);

/* Defaults derived from a volume's voxels. Plain values. */
typedef struct tc_fit {
  tc_stretch stretch;   /* low and high: range of the values without padding; middle: threshold between object and
                           background */
  const char *preset;   /* name of a transfer function; static */
  bool hounsfield;      /* values are Hounsfield units */
  double dense;         /* smallest value of the body and of a scanner's table */
  double surface;       /* for isosurfaces */
  struct { double center, width; } windows[TC_MODE_COUNT]; /* by mode; width 0: the mode has none */
} tc_fit;

/* tc_fit_find() reads every voxel once. tc_fit_windows() samples a coarse grid of `body`, the part of the volume that
 * is shown (NULL: all of it). */
void tc_fit_find(tc_fit *fit, const tc_volume *volume);
void tc_fit_windows(tc_fit *fit, const tc_volume *volume, const tc_volume *body);
/* The volume without tables and padding (volume/body.h), for scenes that hide them; the caller unrefs. NULL: nothing to
 * hide, stopped, or out of memory. goes_on, reserve, user: as in tc_body_options. */
tc_volume *tc_fit_body(const tc_fit *fit, const tc_volume *volume, bool (*goes_on)(void *user),
                       bool (*reserve)(void *user, uint64_t bytes), void *user);

/* Sets defaults that fit a volume: a camera that shows all of it from the front (the patient's anterior, head up; a
 * thin volume from its broad side), preset and window for its modality and range; unlit, unclipped, opacity per mm.
 * *scene must have been initialised (tc_scene_init). */
void tc_scene_fit(tc_scene *scene, const tc_volume *volume);
/* As tc_scene_fit(), from a fit, for a session's first picture: lit if the preset is lit, and the table hidden if
 * has_body. */
void tc_scene_dress(tc_scene *scene, const tc_volume *volume, const tc_fit *fit, bool has_body);

/* Drops cached resources of a volume (or label volume) that is going away. */
void tc_renderer_forget(tc_renderer *renderer, const tc_volume *volume);
/* Drops cached clusters that contain a mesh, by its serial. */
void tc_renderer_forget_mesh(tc_renderer *renderer, uint64_t mesh_serial);

#endif
