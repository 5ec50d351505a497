/* The scene: everything a client can ask of a picture, as plain values.
 *
 * Positions are mm in patient LPS (x to the left, y to the back, z to the head), colours sRGB 0..1,
 * values in the volume's own unit (HU for CT). A tc_scene is complete: tc_scene_init() fills every
 * member with its default, tc_scene_fit() (tomocast.h) sets the defaults that depend on a volume. Plain data
 * without locks: any thread, one at a time. Heap members are owned by the scene (tc_scene_clear). */
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
/* Source of the normals for shading:
 *   cell     derivative of the trilinear field within a cell: cheapest, but discontinuous at cell faces (for an
 *            isosurface: differences over a cube of two voxels around the hit);
 *   central  central differences at voxels (one-sided on the volume's faces), interpolated trilinearly;
 *   cubic    derivative of the cubic B-spline of the voxels, which also smooths noise. */
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

/* Names of the enumerators in scene documents, kernel names and plans; NULL-terminated. */
extern const char *const tc_mode_names[], *const tc_classification_names[], *const tc_order_names[],
    *const tc_filter_names[], *const tc_shading_names[], *const tc_gradient_names[], *const tc_slab_projection_names[];

/* What a knot's amount is (NUMERICS): opacity, linear between knots, with extinction
 * tau = -log1p(-opacity)/unit_distance; or extinction in 1/mm, linear between knots. */
typedef enum tc_knot_kind { TC_KNOT_OPACITY, TC_KNOT_EXTINCTION, TC_KNOT_KIND_COUNT } tc_knot_kind;

typedef struct tc_knot {
  double value;    /* in the volume's unit; knots are kept in ascending order, equal values make a jump */
  double color[3]; /* sRGB 0..1 */
  double amount;   /* opacity 0..1 per unit distance, or extinction >= 0 in 1/mm */
} tc_knot;

/* An immutable list that several scenes share by atomic reference count; the scenes may be on different threads. */
typedef struct tc_shared tc_shared;

typedef struct tc_transfer_function {
  tc_knot *points; /* [count]; the function is constant before the first and after the last */
  tc_shared *shared; /* owner of points, shared with other scenes; NULL: the scene owns them alone */
  size_t count;    /* >= 1 in a valid scene */
  tc_knot_kind kind;
  double unit_distance_mm; /* > 0; only for TC_KNOT_OPACITY */
  char preset[48];         /* name of the preset that the points came from, or "" */
} tc_transfer_function;

typedef struct tc_camera {
  tc_projection projection;
  double position[3], target[3], up[3]; /* LPS mm; up need not be orthogonal to the view direction */
  double fov_y_deg;                     /* perspective: full vertical angle, 0 < fov < 180 */
  double height_mm;                     /* orthographic: what the image's height spans, > 0 */
} tc_camera;

typedef struct tc_label_color { uint32_t label; double rgba[4]; } tc_label_color;

/* Source of a surface in a scene's list of surfaces. */
typedef enum tc_surface_source {
  TC_SURFACE_OF_VALUE, /* the volume's isosurface */
  TC_SURFACE_OF_LABEL, /* the surface of one label of labels.volume */
  TC_SURFACE_OF_MESH,  /* a mesh that the client uploaded or the catalogue holds */
  TC_SURFACE_OF_PLANE, /* a slice of the volume, placed by mpr.center, normal and up, in the window's greys */
  TC_SURFACE_SOURCE_COUNT
} tc_surface_source;

/* A light for surfaces. */
typedef struct tc_mesh_light {
  bool at_camera;
  double direction[3]; /* towards the light, LPS; not read if at_camera */
  double color[3], intensity;
} tc_mesh_light;

#define TC_MAX_LIGHTS 8

/* Zero-initialise (g_new0()): tc_shared_digest() hashes all bytes, padding included. */
typedef struct tc_mesh_surface {
  tc_surface_source source;
  int label;
  double value;
  char mesh[64]; /* id */
  tc_mpr_orientation plane;
  double color[3], opacity;
  bool has_color; /* false: the colour of its source (the label's, the mesh's vertices', or isosurface.color) */
  bool visible;
  bool two_sided; /* false: back-face culling */
  unsigned own_shading; /* bit i set: the i-th member below (bit 0 = model) overrides scene.shading */
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
    bool prefilter;     /* filter cubic: interpolates the voxels by their B-spline coefficients, instead of smoothing
                           them */
    double termination; /* early ray termination: a ray ends when its transparency is below this; 0: never */
  } sampling;
  struct { tc_skipping_mode mode; int block; /* voxels, 0 = automatic */ } skipping;
  struct {
    tc_shading_model model;
    tc_gradient gradient; /* filter cubic always uses the cubic gradient, the derivative of the field it shows */
    double ambient, diffuse, specular, shininess;
    bool light_at_camera;
    double light[3]; /* direction towards the light, LPS; not read if light_at_camera */
  } shading;
  struct { bool has_box; double box[2][3]; double planes[6][4]; int n_planes; } clip;
  struct { double value; double color[3]; } isosurface;
  struct {
    tc_mesh_surface *surfaces; size_t n_surfaces; /* owned as labels.colors is; empty: the surface that isosurface and
                                                     labels describe */
    tc_shared *shared_surfaces;
    tc_mesh_light lights[TC_MAX_LIGHTS]; /* summed; none: shading.light */
    int n_lights;
    bool with_volume; /* dvr and mip draw the surfaces too, composited at their depth along each ray */
  } mesh;
  struct { double threshold[2]; double kernel_radius; char attribute[32]; bool opaque, culling; } splat;
  /* A multiplanar reformat with square pixels, in radiological convention: axial is seen from the feet (patient's
   * right on the left of the picture, front on top), coronal from the front (right on the left, head on top), sagittal
   * from the patient's left (front on the left, head on top). Voxels are opaque in the window's greys (black at
   * center - width/2, white at center + width/2, linear between); outside the volume the background shows, with
   * opacity 0. Mode mpr also reads filter, sampling.step, clip, window, image and labels, and nothing else. */
  struct {
    tc_mpr_orientation orientation;
    bool has_center;        /* else the plane goes through the volume's centre */
    double center[3];       /* LPS mm: the point of the plane at the centre of the picture */
    double normal[3];       /* oblique: normal of the plane, towards the viewer; any length but 0 */
    double up[3];           /* oblique: up in the picture, need not lie in the plane, not parallel to the normal */
    double thickness_mm;    /* >= 0; a slab extends by half of it to both sides of the plane; 0 is one slice */
    tc_slab_projection projection; /* of a slab: over samples on the plane, every sampling.step from the plane, and on
                                      both faces of the slab (or where the volume or a clip plane ends it); average by
                                      the trapezoidal rule */
    double zoom;            /* > 0; at 1 the volume's extent just fits the picture; at 2 half of the extent does */
  } mpr;
  /* A label volume (classify/labels.h). Labels tint in dvr and mpr, hide in dvr, and give mode mesh its surfaces and
   * mode splat its colours. Other modes ignore it. */
  struct {
    char volume[64]; /* id of the label volume; "" = none */
    double opacity;  /* 0..1; opacity of a tint = this times the alpha of the label's colour */
    tc_label_color *colors; size_t n_colors;  /* owned; ascending labels; other labels have their palette colour, label
                                                 0 is clear */
    uint32_t *visible; size_t n_visible;      /* owned; visible labels, 0 stands for unlabelled voxels; NULL = all */
    tc_shared *shared_colors, *shared_visible; /* as tc_transfer_function.shared */
  } labels;
  bool hide_table; /* shows only the body (volume/body.h), if one was found, in all modes but mpr */
  struct { double max_error, max_ms; } quality; /* bounds; 0 = none */
  struct { int pixels; } error_meter;           /* pixels to measure; 0 = off */
} tc_scene;

/* Limits of a scene (PROTOCOL.md, Limits). */
#define TC_MAX_IMAGE_SIDE 8192
#define TC_MAX_IMAGE_AREA 16800000
#define TC_MAX_RAYS_PER_PIXEL 64
#define TC_MAX_KNOTS 65536
#define TC_MAX_SURFACES 256

/* Fills every member with a default that needs no volume. *scene is overwritten, not cleared. */
void tc_scene_init(tc_scene *scene);

/* Copies *from into *to, which is overwritten, not cleared. Shared lists gain a reference; the others are copied, and
 * the copies are shared from then on. */
void tc_scene_copy(tc_scene *to, const tc_scene *from);

/* Makes the scene's lists shared: later copies only add a reference. The lists are immutable from now on; to change
 * one, replace it (tc_scene_set_...). */
void tc_scene_share(tc_scene *scene);

/* Replace a list. The scene takes ownership of the new one, which was allocated by g_malloc(). */
void tc_scene_set_points(tc_scene *scene, tc_knot *points, size_t count);
void tc_scene_set_colors(tc_scene *scene, tc_label_color *colors, size_t count);
void tc_scene_set_visible(tc_scene *scene, uint32_t *visible, size_t count);
void tc_scene_set_surfaces(tc_scene *scene, tc_mesh_surface *surfaces, size_t count);
/* Replace a list by that of another scene: by a reference if it is shared, else by a copy. */
void tc_scene_take_points(tc_scene *scene, const tc_scene *from);
void tc_scene_take_colors(tc_scene *scene, const tc_scene *from);
void tc_scene_take_visible(tc_scene *scene, const tc_scene *from);
void tc_scene_take_surfaces(tc_scene *scene, const tc_scene *from);

/* Hash of a shared list's bytes, computed once and cached. Equal lists have equal hashes within one process; different
 * lists almost never collide. Returns 0 for NULL. */
uint64_t tc_shared_digest(tc_shared *shared);

/* Releases heap members and zeroes *scene. A cleared or zeroed scene may be cleared again. */
void tc_scene_clear(tc_scene *scene);

/* Default colours of labels: label n > 0 has colour (n - 1) % count. sRGB; static. */
#define TC_LABEL_PALETTE 21
const double (*tc_label_palette(size_t *count))[3];

/* A named transfer function. `modality` is "CT", "MR" or "" (any). */
typedef struct tc_preset {
  const char *name, *title, *modality;
  tc_knot_kind kind;
  double unit_distance_mm;
  const tc_knot *points;
  size_t count;
  bool relative; /* knot values are 0..1 of the volume's value range */
  bool lit;      /* meant to be shown with the light of tc_scene_light(); else unlit */
} tc_preset;

/* Maps a preset to a volume. Knots 0, TC_STRETCH_MIDDLE and 1 of a relative preset go to the values low, middle and
 * high, linear between. Unit distances are multiplied by `unit`, so that the picture does not depend on the size in mm
 * that the file declares. */
typedef struct tc_stretch { double low, middle, high, unit; } tc_stretch;
#define TC_STRETCH_MIDDLE 0.35

typedef struct tc_window_preset { const char *name, *title, *modality; double center, width; } tc_window_preset;

/* All presets, in menu order; static. */
const tc_preset *tc_presets(size_t *count);
const tc_window_preset *tc_window_presets(size_t *count);

/* Replaces the points of *tf by those of the named preset. A relative preset is scaled to the values lo .. hi, or by
 * the stretch. False: no such name. */
bool tc_transfer_function_set_preset(tc_transfer_function *tf, const char *name, double lo, double hi);
bool tc_transfer_function_fit_preset(tc_transfer_function *tf, const char *name, const tc_stretch *stretch);

/* NULL: no such name. */
const tc_preset *tc_preset_named(const char *name);

/* Sets the shading: lit: that of lit presets, Blinn-Phong with normals by central differences; else
 * tc_scene_init()'s. */
void tc_scene_light(tc_scene *scene, bool lit);

#endif
