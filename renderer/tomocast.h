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

/* Which processor computes pre-integration tables for the gl back end; the entries agree within 1e-6. auto: the GPU, or the
 * cpu where OpenGL runs in software. The cpu back end always uses tables of the cpu. */
typedef enum tc_table_builder { TC_TABLES_AUTO, TC_TABLES_CPU, TC_TABLES_GL } tc_table_builder;

typedef struct tc_renderer_options {
  tc_backend backend;
  int threads;          /* CPU workers; 0 = one per online core */
  const char *isa;      /* "scalar" "avx2" "avx512-gather" "avx512"; NULL = the fastest here (raycast/cpu/isa.h) */
  uint64_t cache_bytes; /* budget of tables and other shared resources; 0 = 256 MiB */
  const tc_ledger *ledger; /* is asked for these, and outlives the renderer: what a frame needs may exceed cache_bytes, but not
                              what the ledger has (TC_ERROR_MEMORY). NULL: no bound */
  tc_table_builder tables; /* for tests and measurements */
  bool levels;          /* make levels of detail of large meshes, on another thread, after a frame at rest drew all triangles */
} tc_renderer_options;

typedef struct tc_renderer_info {
  const char *backend; /* "cpu" or "gl" */
  const char *why;     /* one sentence: why this one */
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
  uint64_t gradients;                   /* computed to shade a segment or a hit; their own fetches do not count as samples */
  uint64_t rays;                        /* rays that met the volume */
  /* jumps over empty space, counted as the back end makes them (packets or rays) */
  uint64_t leaps;
  bool stand_in; /* the cpu back end drew in place of the gl back end: this time does not predict the next frame's */
} tc_frame_stats;

/* A finished picture. Zero-initialise before first use; buffers are reused by the next tc_render(). */
typedef struct tc_frame {
  int width, height;
  uint8_t *rgba;     /* [height][width][4], row 0 on top, sRGB; alpha straight (255 unless background is transparent) */
  float *linear;     /* [height][width][4], only on request: premultiplied colour in the compositing space and opacity,
                        without the background; for measurements */
  float *depth;      /* [height][width], only on request and in modes isosurface, mesh and splat: mm from the eye to the surface along the
                        pixel's ray (the nearest of several rays), infinite where no ray meets the surface */
  size_t capacity;   /* pixels allocated in rgba */
  size_t linear_capacity, depth_capacity;
  tc_frame_stats stats;
  struct tc_progress *progress; /* the renderer's: how far a paused frame is */
} tc_frame;

/* Finished share of the frame, 0..1: resuming a paused frame does not draw this share again. */
double tc_frame_done(const tc_frame *frame);
/* How many calls in a row were paused before they made any progress on this paused frame. */
int tc_frame_fruitless(const tc_frame *frame);
/* Bytes that drawing a frame of the scene needs, without the layers of surfaces in a volume. measured: with linear colour
 * and depth. */
uint64_t tc_frame_need(const tc_scene *scene, int width, int height, bool measured);
/* Bytes of the frame's buffers and of what a paused frame keeps beside them. */
uint64_t tc_frame_bytes(const tc_frame *frame);

/* Drops what a paused frame keeps, if it will not be resumed; the buffers stay. */
void tc_frame_give_up(tc_frame *frame);
void tc_frame_finish(tc_frame *frame); /* frees the buffers; a zeroed frame is fine */

#define TC_MAX_TABLE_SIZE 4096

typedef struct tc_render_request {
  int width, height;          /* 0 = the scene's own; smaller while a user drags (the camera's view stays the same) */
  bool want_linear;           /* fill frame->linear too */
  bool want_depth;            /* and frame->depth, in the modes that have one */
  const tc_interrupt *interrupt; /* ends the call with TC_ERROR_CANCELLED or TC_ERROR_PAUSED; may be NULL */
  tc_explanation *explanation; /* says of a finished frame what was drawn and why, with the milliseconds and bytes of each
                                  stage; may be NULL */
  tc_building *building;      /* shows other threads which resource is being built; may be NULL */
  const tc_ledger *ledger;    /* is asked for the layers of translucent surfaces, a number that only drawing tells, before their
                                 allocation. What a paused or finished frame keeps of them, tc_frame_bytes() counts: the caller
                                 takes all back when the call returns. NULL: no bound */
  /* Resumes a frame that ended with TC_ERROR_PAUSED. Volume, scene, request (but for the interrupt) and tc_frame have to be
   * the same. Finished pixels are kept, stats go on counting (a ray that is cast again counts again), and the picture equals
   * an uninterrupted one to the last bit. A frame that was not paused is drawn from the start. */
  bool resume;
  const tc_volume *labels;    /* the volume that scene.labels.volume names, borrowed until tc_render() returns; NULL where the
                                 scene names none. The caller resolves ids; tc_labels_check() runs here */
  struct tc_mesh *const *meshes; /* [surfaces of scene.mesh]: the mesh of each surface that names one, else NULL; borrowed
                                 likewise. NULL where no surface names a mesh */
  bool hurry;                 /* do not wait for the gl back end to compile a program or upload a large volume: the cpu
                                 back end draws this frame, equal within 1/255 (stats.stand_in) */
  bool moving;                /* the scene is being changed: surfaces may lose details smaller than a pixel */
  int table_size,
      table_bits; /* for measurements: entries per side (2 to TC_MAX_TABLE_SIZE) and bits of an entry (8, or 16
                                 for half floats) of the pre-integration table; 0 = the plan's choice, single precision */
  bool forward;               /* for measurements: shade opaque triangles as they are drawn, one sample a pixel (mesh/raster.h) */
  double pixel_share;         /* for measurements: a pixel's rays spread over this share of its width, so that a small picture
                                 samples the pixels of a large one; 0 = 1, all of it */
} tc_render_request;

/* Renders one frame. request may be NULL. After a failure the frame's content is undefined (except for TC_ERROR_PAUSED, see
 * resume) and the renderer can be used on. A scene that asks for something not built is TC_ERROR_UNSUPPORTED with a pointer
 * to the member: never a wrong picture. A scene that still asks for a bound on error or time is refused: quality/quality.h
 * and quality/cost.h turn such a bound into sampling. */
bool tc_render(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
               tc_frame *frame, GError **error);

/* Explains the frame that this renderer would draw with what is resident now, and draws nothing of the scene. While
 * explanation->object_measured is false, each call for a solid object spends about 5 ms on measuring this machine's speed.
 * request: its labels and interrupt count; a cancelled call leaves out what the object would cost. May be NULL. Same thread
 * rule as tc_render(). */
bool tc_renderer_explain(tc_renderer *renderer, const tc_volume *volume, const tc_scene *scene,
                         const tc_render_request *request, tc_explanation *explanation, GError **error);

/* What a pixel of mode mesh shows. */
typedef struct tc_pick {
  double at[2];       /* the pixel, as for tc_renderer_pick(); given */
  bool found;
  double position[3]; /* LPS mm */
  double distance_mm; /* from the eye */
  double value;       /* iso value of the surface, or the volume's value in a slice; NaN for meshes and labels */
  int surface;        /* index in scene.mesh.surfaces; -1: the scene has no list */
  uint32_t label;     /* the label whose surface this is; 0: not a label's surface */
} tc_pick;

/* Picks the surface at pixel position pick->at (x, y: the centre of pixel i is i + 0.5). Of the request labels, meshes, width and height are read, as for a frame.
 * Reads the surfaces that a frame of the scene drew and builds none: TC_ERROR_BUSY where they are missing. Same thread rule
 * as tc_render(). */
bool tc_renderer_pick(tc_renderer *renderer, const tc_volume *volume, const tc_scene *scene,
                      const tc_render_request *request, tc_pick *pick, GError **error);

/* Defaults derived from a volume's voxels. Plain values. */
typedef struct tc_fit {
  tc_stretch stretch;   /* low and high of the values without padding; the middle separates the object from its surroundings */
  const char *preset;   /* name of a transfer function; static */
  bool hounsfield;      /* values are Hounsfield units */
  double dense;         /* least value of the body and of a scanner's table */
  double surface;       /* for isosurfaces */
  struct { double center, width; } windows[TC_MODE_COUNT]; /* by mode; width 0: the mode has none */
} tc_fit;

/* tc_fit_find() reads every voxel once. tc_fit_windows() reads few voxels of `body`, the part of the volume that is shown
 * (NULL: all of it). */
void tc_fit_find(tc_fit *fit, const tc_volume *volume);
void tc_fit_windows(tc_fit *fit, const tc_volume *volume, const tc_volume *body);
/* The volume without tables and padding (volume/body.h), for scenes that hide them; NULL: nothing to hide, or no memory. */
tc_volume *tc_fit_body(const tc_fit *fit, const tc_volume *volume, bool (*goes_on)(void *user),
                       bool (*reserve)(void *user, uint64_t bytes), void *user);

/* Defaults that fit a volume: a camera that shows all of it from the front (the patient's anterior, head up; a thin volume
 * from its broad side), preset and window for its modality and range; unlit, uncropped, opacity per mm. *scene was
 * initialised (tc_scene_init) before. */
void tc_scene_fit(tc_scene *scene, const tc_volume *volume);
/* The same from a fit, as a first picture is shown: lit as the preset is, the table hidden. */
void tc_scene_dress(tc_scene *scene, const tc_volume *volume, const tc_fit *fit, bool has_body);

/* Drops cached resources of a volume (or label volume) that is going away. */
void tc_renderer_forget(tc_renderer *renderer, const tc_volume *volume);
/* Drops cached clusters that contain a mesh, by its serial. */
void tc_renderer_forget_mesh(tc_renderer *renderer, uint64_t mesh_serial);

#endif
