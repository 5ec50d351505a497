/* The scene: everything a client can ask of a picture, as plain values.
 *
 * Positions are mm in patient LPS (x to the left, y to the back, z to the head), colours sRGB 0..1,
 * values in the volume's own unit (HU for CT). A tc_scene is complete: tc_scene_init() fills every
 * member with its default, tc_scene_fit() (tomocast.h) adds what depends on a volume. Plain data:
 * no locks, any thread, but one at a time. Heap members are owned by the scene (tc_scene_clear). */
#ifndef TC_RENDERER_SCENE_H
#define TC_RENDERER_SCENE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef enum tc_mode {
  TC_MODE_DVR, TC_MODE_MIP, TC_MODE_MINIP, TC_MODE_AVERAGE, TC_MODE_ISOSURFACE, TC_MODE_MESH, TC_MODE_SPLAT,
  TC_MODE_MPR, TC_MODE_COUNT
} tc_mode;
typedef enum tc_image_format { TC_FORMAT_JPEG, TC_FORMAT_PNG, TC_FORMAT_COUNT } tc_image_format;
typedef enum tc_subsampling {
  TC_SUBSAMPLING_AUTO,
  TC_SUBSAMPLING_444,
  TC_SUBSAMPLING_422,
  TC_SUBSAMPLING_420,
  TC_SUBSAMPLING_COUNT
} tc_subsampling;
typedef enum tc_projection { TC_PERSPECTIVE, TC_ORTHOGRAPHIC, TC_PROJECTION_COUNT } tc_projection;
typedef enum tc_classification {
  TC_PREINTEGRATED, TC_PREINTEGRATED2, TC_APPROXIMATE, TC_POST, TC_LINEARIZED, TC_CLASSIFICATION_COUNT
} tc_classification;
typedef enum tc_compositing_order { TC_FRONT_TO_BACK, TC_BACK_TO_FRONT, TC_ORDER_COUNT } tc_compositing_order;
typedef enum tc_filter { TC_FILTER_LINEAR, TC_FILTER_CUBIC, TC_FILTER_NEAREST, TC_FILTER_COUNT } tc_filter;
typedef enum tc_skipping_mode { TC_SKIPPING_AUTO, TC_SKIPPING_OFF, TC_SKIPPING_COUNT } tc_skipping_mode;
typedef enum tc_shading_model {
  TC_SHADING_NONE,
  TC_SHADING_LAMBERT,
  TC_SHADING_BLINN_PHONG,
  TC_SHADING_GOOCH,
  TC_SHADING_COUNT
} tc_shading_model;
/* Where shading's normals come from: the derivative of the trilinear field within a cell, which costs least and jumps
 * at cell faces (of an isosurface: the cube of two voxels around the hit); central differences at voxels (one-sided in
 * a face), interpolated; the derivative of the cubic B-spline of the voxels, which smooths noise too. */
typedef enum tc_gradient { TC_GRADIENT_CELL, TC_GRADIENT_CENTRAL, TC_GRADIENT_CUBIC, TC_GRADIENT_COUNT } tc_gradient;
typedef enum tc_mpr_orientation {
  TC_AXIAL,
  TC_CORONAL,
  TC_SAGITTAL,
  TC_OBLIQUE,
  TC_MPR_ORIENTATION_COUNT
} tc_mpr_orientation;
typedef enum tc_slab_projection {
  TC_SLAB_MIP,
  TC_SLAB_MINIP,
  TC_SLAB_AVERAGE,
  TC_SLAB_PROJECTION_COUNT
} tc_slab_projection;

/* The words for these in documents, kernels and plans; after the last comes NULL. */
extern const char *const tc_mode_names[], *const tc_classification_names[], *const tc_order_names[],
    *const tc_filter_names[], *const tc_shading_names[], *const tc_gradient_names[], *const tc_slab_projection_names[];

/* How a transfer function's knots give extinction (NUMERICS: opacity is linear between knots and
 * tau = -log1p(-opacity)/unit_distance; extinction is linear between knots, 1/mm). */
typedef enum tc_knot_kind { TC_KNOT_OPACITY, TC_KNOT_EXTINCTION, TC_KNOT_KIND_COUNT } tc_knot_kind;

typedef struct tc_knot {
  double value;    /* in the volume's unit; knots are kept in ascending order, equal values make a jump */
  double color[3]; /* sRGB 0..1 */
  double amount;   /* opacity 0..1 per unit distance, or extinction >= 0 in 1/mm */
} tc_knot;

/* A list that several scenes hold by reference: it is never changed. Atomic, so scenes that share may be on different
 * threads. */
typedef struct tc_shared tc_shared;

typedef struct tc_transfer_function {
  tc_knot *points; /* [count], owned by the scene, or `shared` with others; constant beyond the first and the last */
  tc_shared *shared; /* holds points; NULL: they are the scene's own */
  size_t count;    /* >= 1 in a valid scene */
  tc_knot_kind kind;
  double unit_distance_mm; /* > 0; only for TC_KNOT_OPACITY */
  char preset[48];         /* name the points came from, or "" */
} tc_transfer_function;

typedef struct tc_camera {
  tc_projection projection;
  double position[3], target[3], up[3]; /* LPS mm; up need not be orthogonal to the view direction */
  double fov_y_deg;                     /* perspective: full vertical angle, 0 < fov < 180 */
  double height_mm;                     /* orthographic: what the image's height spans, > 0 */
} tc_camera;

typedef struct tc_label_color { uint32_t label; double rgba[4]; } tc_label_color;

/* Where one of several surfaces comes from. */
typedef enum tc_surface_source {
  TC_SURFACE_OF_VALUE, /* the volume's isosurface */
  TC_SURFACE_OF_LABEL, /* of labels.volume */
  TC_SURFACE_OF_MESH,  /* a mesh of its own */
  TC_SURFACE_OF_PLANE, /* a slice of the volume, where mpr.center, normal and up have it, with the window's greys */
  TC_SURFACE_SOURCE_COUNT
} tc_surface_source;

/* Light on surfaces. */
typedef struct tc_mesh_light {
  bool at_camera;
  double direction[3]; /* to the light, LPS, when not at the camera */
  double color[3], intensity;
} tc_mesh_light;

#define TC_MAX_LIGHTS 8

/* All bytes of it count in a digest: made by g_new0(). */
typedef struct tc_mesh_surface {
  tc_surface_source source;
  int label;
  double value;
  char mesh[64]; /* id */
  tc_mpr_orientation plane;
  double color[3], opacity;
  bool has_color; /* else that of its source: of the label, of the mesh's vertices, or isosurface.color */
  bool visible;
  bool two_sided; /* else what faces away from the eye is not drawn */
  unsigned own_shading; /* bits of what follows, model first, that is its own; else shading's */
  tc_shading_model model;
  double ambient, diffuse, specular, shininess;
} tc_mesh_surface;

typedef struct tc_scene {
  tc_mode mode;
  struct {
    int width, height; /* pixels */
    double background[3];
    bool transparent; /* background "transparent": straight alpha in a PNG */
    tc_image_format format;
    int quality; /* JPEG 1..100 */
    tc_subsampling subsampling;
    bool linear_light; /* composite in linear light and encode to sRGB; else in display space */
  } image;
  tc_camera camera;
  tc_transfer_function transfer_function;
  struct { double center, width; } window;
  tc_classification classification;
  tc_compositing_order order;
  tc_filter filter;
  struct {
    double step; /* voxels of the smallest spacing, > 0 */
    int rays_per_pixel;
    bool coherence, jitter;
    bool prefilter;     /* cubic: through the voxels, by their B-spline coefficients, instead of smoothing them */
    double termination; /* a ray ends when its transparency is below this; 0 never ends it */
  } sampling;
  struct { tc_skipping_mode mode; int block; /* voxels, 0 = chosen */ } skipping;
  struct {
    tc_shading_model model;
    tc_gradient gradient; /* with filter cubic always cubic: the derivative of what is seen */
    double ambient, diffuse, specular, shininess;
    bool light_at_camera;
    double light[3]; /* direction to the light, LPS, when not at the camera */
  } shading;
  struct { bool has_box; double box[2][3]; double planes[6][4]; int n_planes; } clip;
  struct { double value; double color[3]; } isosurface;
  struct {
    tc_mesh_surface *surfaces; size_t n_surfaces; /* as labels.colors; none: what isosurface and labels say */
    tc_shared *shared_surfaces;
    tc_mesh_light lights[TC_MAX_LIGHTS]; /* of surfaces, added up; none: shading.light */
    int n_lights;
    bool with_volume; /* dvr and mip draw the surfaces too, each where it is along the rays */
  } mesh;
  struct { double threshold[2]; double kernel_radius; char attribute[32]; bool opaque, culling; } splat;
  /* A planar reformat, with square pixels and as radiologists hold pictures: axial is seen from the feet (patient's
   * right on the left of the picture, front on top), coronal from the front (right on the left, head on top), sagittal
   * from the patient's left (front on the left, head on top). Voxels show the window's greys with opacity 1 (black at
   * center - width/2, white at center + width/2, linear between); where there is no volume the background shows, with
   * opacity 0. Only filter, sampling.step, clip, window and image mean something beside; the rest is ignored. */
  struct {
    tc_mpr_orientation orientation;
    bool has_center;        /* else the plane goes through the volume's centre */
    double center[3];       /* LPS mm: on the plane, in the middle of the picture */
    double normal[3];       /* oblique: normal of the plane, towards the viewer; any length but 0 */
    double up[3];           /* oblique: up in the picture, need not lie in the plane, not parallel to the normal */
    double thickness_mm;    /* >= 0; a slab lies half before and half behind the plane; 0 is one slice */
    tc_slab_projection projection; /* of a slab: of samples on the plane, every sampling.step from it, and on both
                                      faces (the volume's or a clip plane's where it ends there); average by the
                                      trapezoidal rule */
    double zoom;            /* > 0; at 1 the volume's extent across and up the picture just fits; 2 shows half of it */
  } mpr;
  /* A second volume of labels (classify/labels.h) that tints in dvr and mpr, and hides in dvr; a mesh is their surfaces.
   * Other modes ignore it. */
  struct {
    char volume[64]; /* id of a second volume; "" = none */
    double opacity;  /* 0..1; a tint's share is this times its colour's own */
    tc_label_color *colors; size_t n_colors;  /* owned; ascending labels; one without is of the palette, 0 is clear */
    uint32_t *visible; size_t n_visible;      /* owned; NULL = all; 0, what has no label, is one of them */
    tc_shared *shared_colors, *shared_visible; /* as tc_transfer_function.shared */
  } labels;
  bool hide_table; /* the body alone (volume/body.h), where one was found, in all modes but mpr */
  struct { double max_error, max_ms; } quality; /* 0 = not asked */
  struct { int pixels; } error_meter;           /* 0 = off */
} tc_scene;

/* Limits a scene is checked against (PROTOCOL.md, Limits). */
#define TC_MAX_IMAGE_SIDE 8192
#define TC_MAX_IMAGE_AREA 16800000
#define TC_MAX_RAYS_PER_PIXEL 64
#define TC_MAX_KNOTS 65536
#define TC_MAX_SURFACES 256

/* Fills every member with a default that needs no volume. *scene holds nothing before. */
void tc_scene_init(tc_scene *scene);

/* Copy into *to, which holds nothing before. Lists that *from shares are shared with it too, the others copied; the
 * copy's own lists are ready to be shared on. */
void tc_scene_copy(tc_scene *to, const tc_scene *from);

/* From now on copies share this scene's lists, which nobody may change any more: only replace (tc_scene_set_...). */
void tc_scene_share(tc_scene *scene);

/* Replace a list by another one of g_malloc's, which is then the scene's own. */
void tc_scene_set_points(tc_scene *scene, tc_knot *points, size_t count);
void tc_scene_set_colors(tc_scene *scene, tc_label_color *colors, size_t count);
void tc_scene_set_visible(tc_scene *scene, uint32_t *visible, size_t count);
void tc_scene_set_surfaces(tc_scene *scene, tc_mesh_surface *surfaces, size_t count);
/* Take over lists of another scene, shared where that shares. */
void tc_scene_take_points(tc_scene *scene, const tc_scene *from);
void tc_scene_take_colors(tc_scene *scene, const tc_scene *from);
void tc_scene_take_visible(tc_scene *scene, const tc_scene *from);
void tc_scene_take_surfaces(tc_scene *scene, const tc_scene *from);

/* Of the bytes of a shared list: equal lists have equal numbers in one process, different ones hardly ever. Computed
 * once. NULL: 0. */
uint64_t tc_shared_digest(tc_shared *shared);

/* Releases heap members and zeroes *scene. A cleared or zeroed scene may be cleared again. */
void tc_scene_clear(tc_scene *scene);

/* Colours of labels that have none of their own: label n > 0 takes number (n - 1) % count. sRGB; static. */
#define TC_LABEL_PALETTE 21
const double (*tc_label_palette(size_t *count))[3];

/* A named transfer function. `modality` is "CT", "MR" or "" (any; values 0..1 of the range when
 * `relative`). `center`/`width` is a window that goes with it. */
typedef struct tc_preset {
  const char *name, *title, *modality;
  tc_knot_kind kind;
  double unit_distance_mm;
  const tc_knot *points;
  size_t count;
  bool relative; /* knot values are 0..1 of the volume's value range */
  bool lit;      /* shown with tc_scene_light(), else without light */
} tc_preset;

/* How presets are fitted to a volume: where 0, TC_STRETCH_MIDDLE and 1 of a relative one are among its values, linear
 * between, and what unit distances are multiplied by, so that a picture does not depend on how large a volume is said to
 * be. */
typedef struct tc_stretch { double low, middle, high, unit; } tc_stretch;
#define TC_STRETCH_MIDDLE 0.35

typedef struct tc_window_preset { const char *name, *title, *modality; double center, width; } tc_window_preset;

/* All presets, in menu order; static. */
const tc_preset *tc_presets(size_t *count);
const tc_window_preset *tc_window_presets(size_t *count);

/* Puts the named preset into *tf (replacing its points; `lo`, `hi` scale a relative one). False: no such name. */
bool tc_transfer_function_set_preset(tc_transfer_function *tf, const char *name, double lo, double hi);
bool tc_transfer_function_fit_preset(tc_transfer_function *tf, const char *name, const tc_stretch *stretch);

/* NULL: no such name. */
const tc_preset *tc_preset_named(const char *name);

/* The light of lit presets: Blinn-Phong, with normals of central differences. Without: what tc_scene_init() has. */
void tc_scene_light(tc_scene *scene, bool lit);

#endif
