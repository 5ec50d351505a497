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
#include "renderer/plan/estimate.h"
#include "renderer/plan/explain.h"
#include "renderer/plan/plan.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/histogram.h"
#include "renderer/volume/volume.h"

typedef enum tc_backend { TC_BACKEND_AUTO, TC_BACKEND_CPU, TC_BACKEND_GL, TC_BACKEND_COUNT } tc_backend;

/* Who makes the entries of pre-integration tables for the gl back end: the same within 1e-6. auto: a GPU its own; the cpu
 * where OpenGL is software, as for the cpu back end, which takes no other. */
typedef enum tc_table_builder { TC_TABLES_AUTO, TC_TABLES_CPU, TC_TABLES_GL } tc_table_builder;

typedef struct tc_renderer_options {
  tc_backend backend;
  int threads;          /* CPU workers; 0 = one per online core */
  const char *isa;      /* "scalar" "avx2" "avx512-gather" "avx512"; NULL = the fastest here (raycast/cpu/isa.h) */
  uint64_t cache_bytes; /* budget of tables and other shared resources; 0 = 256 MiB */
  tc_table_builder tables; /* for tests and measurements */
  bool levels;          /* of detail of large meshes: made on a thread beside, once a frame at rest has shown one in full */
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
  uint64_t gradients;                   /* taken to shade a segment or a hit; what they fetch themselves is no sample */
  uint64_t rays;                        /* rays that met the volume */
  /* jumps over empty space, counted as the back end makes them (packets or rays) */
  uint64_t leaps;
  bool stand_in; /* drawn by the cpu back end in the gl back end's place: its time tells nothing of the next frame's */
} tc_frame_stats;

/* A finished picture. Zero-initialise before first use; buffers are reused by the next tc_render(). */
typedef struct tc_frame {
  int width, height;
  uint8_t *rgba;     /* [height][width][4], row 0 on top, sRGB; alpha straight (255 unless background is transparent) */
  float *linear;     /* [height][width][4], only when asked: premultiplied colour in the compositing space, and opacity,
                        before the background is put behind it; for measurements */
  float *depth;      /* [height][width], only when asked and in mode isosurface: mm from the eye to the surface along the
                        pixel's ray, of several the nearest, infinite where it meets none; single precision */
  size_t capacity;   /* pixels allocated in rgba */
  size_t linear_capacity, depth_capacity;
  tc_frame_stats stats;
  struct tc_progress *progress; /* the renderer's: how far a paused frame is */
} tc_frame;

/* Share of the frame that is drawn, 0..1: of a paused one, what its next resumption need not draw again. */
double tc_frame_done(const tc_frame *frame);
/* Of a paused one: how many calls in a row were paused before they came any further. */
int tc_frame_fruitless(const tc_frame *frame);
/* What a frame of a scene takes while it is drawn, but for the layers of surfaces in a volume. */
uint64_t tc_frame_need(const tc_scene *scene, int width, int height, bool linear);
/* What its buffers take, and what a paused one keeps beside them. */
uint64_t tc_frame_bytes(const tc_frame *frame);

/* Of a paused one that is not resumed: only its buffers stay. */
void tc_frame_give_up(tc_frame *frame);
void tc_frame_finish(tc_frame *frame); /* frees the buffers; a zeroed frame is fine */

#define TC_MAX_TABLE_SIZE 4096

typedef struct tc_render_request {
  int width, height;          /* 0 = the scene's own; smaller while a user drags (the camera's view stays the same) */
  bool want_linear;           /* fill frame->linear too */
  bool want_depth;            /* and frame->depth, in mode isosurface */
  /* may be NULL; TC_ERROR_CANCELLED or TC_ERROR_PAUSED, soon after it asks */
  const tc_interrupt *interrupt;
  tc_building *building; /* is told what is built meanwhile; may be NULL */
  /* Goes on with a frame that came back with TC_ERROR_PAUSED: the same volume, scene and request (but for the
   * interrupt), and the same tc_frame, untouched. What is finished of it is kept, its stats grow (by
   * all that was done, rays that were left and cast again included), and the picture is the
   * same to the last bit as one made without a pause. A frame that was not paused is begun anew. */
  bool resume;
  const tc_volume *labels;    /* what scene.labels.volume names, borrowed until tc_render() returns; NULL where it names none.
                                 Which volume an id means is the caller's; it is tc_labels_check()ed here */
  struct tc_mesh *const *meshes; /* what those of scene.mesh.surfaces that are of meshes name, at their places of the list; borrowed
                                 likewise. NULL where there are none */
  bool hurry;                 /* never wait for the gl back end to compile a program or upload a large volume: the cpu
                                 back end draws meanwhile, the same within 1/255 (stats.stand_in) */
  bool moving;                /* the scene is being changed: details may be left out that are smaller than a pixel */
  int table_size,
      table_bits; /* for measurements: entries per side (2 to TC_MAX_TABLE_SIZE) and bits of an entry (8, or 16
                                 for half floats) of the pre-integration table; 0 = as the plan chooses, single precision */
  bool forward;               /* for measurements: opaque triangles of one sample are shaded as they are drawn (mesh/raster.h) */
  double pixel_share;         /* for measurements: the rays of a pixel spread over this much of its width, so that a small picture
                                 samples the pixels of a large one; 0 = 1, all of it */
} tc_render_request;

/* Renders one frame. request may be NULL. On failure the frame is left without meaning (but for a paused one, above),
 * the renderer is fine. A scene
 * that asks for something not built is TC_ERROR_UNSUPPORTED with a pointer to the member: never a wrong picture. One
 * that still asks for a bound on error or time is refused: quality/quality.h and quality/cost.h turn that into
 * sampling. *explanation, when not NULL, says what was drawn and why, with the milliseconds and bytes of its stages. */
bool tc_render(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, const tc_render_request *request,
               tc_frame *frame, tc_explanation *explanation, GError **error);

/* What this renderer would do, with what is resident now; renders nothing of the scene. The first calls for an object each
 * give about 5 ms to the measurement of this machine (explanation->object_measured: it is done). labels: as in tc_render_request.
 * Same thread rule as tc_render(). */
bool tc_renderer_explain(tc_renderer *renderer, const tc_volume *volume, const tc_volume *labels, const tc_scene *scene,
                         tc_explanation *explanation, GError **error);

/* What a pixel of mode mesh shows. */
typedef struct tc_pick {
  bool found;
  double position[3]; /* LPS mm */
  double distance_mm; /* from the eye */
  double value;       /* the surface's, or the volume's in a slice; NaN: it has none */
  int surface;        /* place in scene.mesh.surfaces; -1: there is no list */
  uint32_t label;     /* that it is the surface of; 0: of none */
} tc_pick;

/* request: labels, meshes, width and height, as of a frame. Reads the surfaces that a frame of the scene drew, and
 * builds none: TC_ERROR_BUSY where they are not there. Same thread rule as tc_render(). */
bool tc_renderer_pick(tc_renderer *renderer, const tc_volume *volume, const tc_scene *scene,
                      const tc_render_request *request, double x, double y, tc_pick *pick, GError **error);

/* What a volume's voxels tell of how to show it. Plain values. */
typedef struct tc_fit {
  tc_stretch stretch;   /* low and high leave padding out; the middle parts what is shown from what is around it */
  const char *preset;   /* of transfer functions; static */
  bool hounsfield;      /* its values are Hounsfield units */
  double dense;         /* the body's values, and those of tables, from here on */
  double surface;       /* for isosurfaces */
  struct { double center, width; } windows[TC_MODE_COUNT]; /* by mode; width 0: the mode has none */
} tc_fit;

/* Walks the voxels once, and few of `body`'s (or the volume's own, where NULL), which is what is shown of it. */
void tc_fit_find(tc_fit *fit, const tc_volume *volume);
void tc_fit_windows(tc_fit *fit, const tc_volume *volume, const tc_volume *body);
/* The volume without tables and padding (volume/body.h), for who hides them; NULL: there are none, or no memory. */
tc_volume *tc_fit_body(const tc_fit *fit, const tc_volume *volume, bool (*goes_on)(void *user),
                       bool (*reserve)(void *user, uint64_t bytes), void *user);

/* Defaults that fit a volume: camera that shows all of it from the front (patient's anterior, head up; what is thin, from
 * its broad side), transfer function preset and window for its modality and range. *scene was initialised
 * (tc_scene_init) before. Without light, whole, and opacity per mm. */
void tc_scene_fit(tc_scene *scene, const tc_volume *volume);
/* The same from what was found, and how a first picture is shown: lit as the preset is, without tables. */
void tc_scene_dress(tc_scene *scene, const tc_volume *volume, const tc_fit *fit, bool has_body);

/* Drops cached resources of a volume (or label volume) that is going away. */
void tc_renderer_forget(tc_renderer *renderer, const tc_volume *volume);
/* And of a mesh, by its serial: clusters of what it was shown with too. */
void tc_renderer_forget_mesh(tc_renderer *renderer, uint64_t mesh_serial);

#endif
