/* The parts of the reference integrator; private to this folder. */
#ifndef TC_REFERENCE_INTERNAL_H
#define TC_REFERENCE_INTERNAL_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

/* ray.c: from the camera to a ray. Long double, because at 1e7 mm, double resolves only 1e-9 mm. */
typedef struct tc_ref_camera {
  long double position[3], forward[3], right[3], up[3]; /* LPS, orthonormal */
  long double half_width, half_height;                  /* at distance 1 (perspective), or in mm */
  bool perspective;
  int width, height;
} tc_ref_camera;

/* index(t) = origin + t * direction, where origin is the point of the ray nearest to the volume's centre. */
typedef struct tc_ref_ray {
  double origin[3], direction[3];  /* index units, index units per mm */
  double lps[3], lps_direction[3]; /* the same in mm */
  double eye;                      /* t of the eye */
  double enter, leave;             /* t at which the ray enters (not before the eye) and leaves the field's box, mm */
} tc_ref_ray;

/* clip.c: the visible half spaces n.p + d >= 0 in LPS, n of unit length. */
typedef struct tc_ref_clip {
  double planes[12][4];
  int n;
} tc_ref_clip;
void tc_ref_clip_set_up(tc_ref_clip *clip, const tc_scene *scene);
/* Narrows the ray; false: nothing of it is visible. */
bool tc_ref_clip_ray(const tc_ref_clip *clip, tc_ref_ray *ray);

/* NULL, or the name of the meaningless member. */
const char *tc_ref_camera_set_up(tc_ref_camera *camera, const tc_camera *from, int width, int height);
/* The part in a grid's box of what is visible of a ray, over that grid's coordinates; t is the same. False: none. */
bool tc_ref_ray_enter(const tc_ref_ray *open, const tc_volume_desc *desc, tc_ref_ray *box);
/* A pixel's ray. */
typedef struct tc_ref_cast {
  tc_ref_ray box;  /* its visible part in the field's box */
  tc_ref_ray open; /* all that is visible, from the eye on; nothing: enter is not less than leave */
  bool in_box;     /* false: it misses the visible part of the box */
} tc_ref_cast;
void tc_ref_ray_cast(const tc_ref_camera *camera, const tc_ref_clip *clip, const tc_volume_desc *desc, double px,
                     double py, tc_ref_cast *cast);

/* parallel.c */
enum { TC_REF_THREADS = 256 };
typedef struct tc_ref_loop {
  int count;
  const atomic_bool *cancel; /* looked at before each task; NULL: never */
  void (*task)(void *context, int index);
  void *context;
} tc_ref_loop;
/* Calls task for each index, in any order, on so many threads (0: one per online core). False: cancelled. */
bool tc_ref_parallel(const tc_ref_loop *loop, int threads);
static inline bool tc_ref_is_set(const atomic_bool *cancel) {
  return cancel && atomic_load_explicit(cancel, memory_order_relaxed);
}

/* triangles.c: where rays meet a mesh, in double precision through a hierarchy of boxes. */
typedef struct tc_ref_triangles tc_ref_triangles;
typedef struct tc_ref_triangle_hit {
  double t, normal[3]; /* LPS, of any length */
  double color[3];     /* of a mesh with colours; compositing space */
  bool back;           /* met from behind */
} tc_ref_triangle_hit;
struct tc_reference_mesh;
/* Copies; NULL: no memory, or cancelled. linear: the compositing space of colours. On all cores. */
tc_ref_triangles *tc_ref_triangles_new(const struct tc_reference_mesh *mesh, bool linear, const atomic_bool *cancel);
void tc_ref_triangles_free(tc_ref_triangles *triangles);
/* The nearest hit of the ray's part behind `after`. */
bool tc_ref_triangles_hit(const tc_ref_triangles *triangles, const tc_ref_ray *ray, double after, tc_ref_triangle_hit *hit);

/* label_surface.c: the smooth surface of one label, as the field that is 0 there and above 0 within. Any thread. */
enum { TC_REF_LABELS = 65536 };
typedef struct tc_ref_extent_of_label {
  bool found;
  double label;
  int low[3], high[3]; /* its first and last voxel along each axis */
} tc_ref_extent_of_label;
/* [TC_REF_LABELS], by the voxel's bits; free() them. NULL: no memory. cancel: NULL, or what is there is meaningless once it
 * is true. A volume of whole numbers. */
tc_ref_extent_of_label *tc_ref_labels_find(const tc_volume *labels, const atomic_bool *cancel);

typedef struct tc_ref_smooth tc_ref_smooth;
/* The volume outlives it. NULL: no memory. */
tc_ref_smooth *tc_ref_smooth_new(const tc_volume *labels, const tc_ref_extent_of_label *where);
void tc_ref_smooth_free(tc_ref_smooth *smooth);                        /* NULL is fine */
const tc_volume_desc *tc_ref_smooth_desc(const tc_ref_smooth *smooth); /* the field's grid */
double tc_ref_smooth_at(const tc_ref_smooth *smooth, const size_t at[3]); /* mm, about the distance to the surface */
/* Of the cell's corners: 1: all are inside, -1: none is, 0: both are. */
int tc_ref_smooth_side(const tc_ref_smooth *smooth, const size_t low[3]);

/* field.c: the field along a ray, in stretches that lie in one cell, and for filter nearest, next to one voxel. */
typedef struct tc_ref_field {
  tc_filter filter;
  double *coefficients; /* B-spline coefficients for a prefiltered cubic, in the volume's unit; NULL: the voxels themselves */
  const tc_volume_desc *desc;
  const void *voxels;
  const uint8_t *gaps; /* of surfaces: tc_volume_gaps, or NULL */
  const tc_ref_smooth *smooth; /* a label's field instead of voxels, or NULL; cells that it has no surface in are 1 or -1 */
} tc_ref_field;

double tc_ref_voxel(const tc_ref_field *field, const size_t at[3]); /* volume's unit */

/* The voxels around a cell: [z][y][x] from low - 1 to low + 2 along each axis, clamped to the volume. */
typedef struct tc_ref_around {
  bool read; /* the voxels are there; they are read when they are first needed */
  double voxel[4][4][4];
} tc_ref_around;
/* Reads the voxels around the cell above `low`, unless they are there. */
void tc_ref_around_read(tc_ref_around *around, const tc_ref_field *field, const size_t low[3]);

typedef struct tc_ref_walk {
  const tc_ref_field *field;
  const tc_ref_ray *ray;
  tc_ref_around around; /* of the cell that tc_ref_walk_next() gave last */
  double t;        /* where the next cell begins */
  double plane[3]; /* next plane along each axis: integers, and for nearest also halves */
} tc_ref_walk;

/* A cell of the labels' grid: tint r, g, b, its opacity and visibility at the corners, in tc_ref_cell's order. */
typedef struct tc_ref_label_cell {
  double corner[8][5];
  double start[3], delta[3];
} tc_ref_label_cell;

/* The stretch of the ray in one cell: value(u) = c[0] + c[1] u + ... + c[degree] u^degree for u in [0, 1]. */
#define TC_REF_DEGREE 9
typedef struct tc_ref_cell {
  double from, length; /* mm along the ray */
  double c[TC_REF_DEGREE + 1];
  int degree;    /* nearest 0, linear 3, cubic 9 */
  double lo, hi; /* bounds of the value */
  const tc_ref_field *field;
  size_t low[3];             /* the cell's corner of least index */
  tc_ref_around *around;     /* the walk's */
  double corner[8];          /* values at +x (bit 0), +y (bit 1), +z (bit 2) */
  double start[3], delta[3]; /* position within the cell, 0..1: start + u * delta */
  const tc_ref_label_cell *label; /* the label cell that contains the stretch; NULL without labels */
} tc_ref_cell;

/* Solves for the coefficients; g_free() them. NULL: out of memory. cancel: NULL, or the result is meaningless once
 * it is true. */
double *tc_ref_coefficients(const tc_ref_field *field, const atomic_bool *cancel);

void tc_ref_walk_start(tc_ref_walk *walk, const tc_ref_field *field, const tc_ref_ray *ray);
bool tc_ref_walk_next(tc_ref_walk *walk, tc_ref_cell *cell);
/* Of a label's field: the t before which the ray meets no surface; false: it meets none. */
bool tc_ref_walk_bound(const tc_ref_field *field, const tc_ref_ray *ray, double *t);

/* labels.c: a label volume and the scene with its labels' colours; both outlive this. */
typedef struct tc_ref_labels {
  const tc_volume_desc *desc; /* NULL: none */
  const tc_volume *volume;
  const void *voxels;
  const tc_scene *scene;
  bool nearest;
  double dual[3][3]; /* [k]: LPS gradient of index coordinate k, 1/mm */
} tc_ref_labels;

typedef struct tc_ref_label_walk { /* starts as {.u = 1} */
  tc_ref_cell whole;
  tc_ref_label_cell cell;
  double u; /* end of what was returned of `whole` */
} tc_ref_label_walk;

/* 0 outside of the volume. */
double tc_ref_label_at(const tc_volume_desc *desc, const void *voxels, const int at[3]);
void tc_ref_labels_set_up(tc_ref_labels *labels, const tc_volume *volume, const tc_scene *scene);
/* The same for a volume's own gaps (tc_volume_gaps), which hide. `scene` takes the members that say so. */
void tc_ref_labels_of_gaps(tc_ref_labels *labels, const tc_volume *gaps, tc_scene *scene);
/* The colour of a label (compositing space); false: it has none. */
bool tc_ref_label_color(const tc_volume *labels, const tc_scene *scene, double label, double rgb[3]);
/* tc_ref_walk_next() with stretches also cut at the faces of the labels' grid; cell->label lives until the next
 * call. */
bool tc_ref_labels_next(const tc_ref_labels *labels, tc_ref_walk *walk, tc_ref_label_walk *at, tc_ref_cell *cell);
/* Returns the visibility at u; tint receives the mean tint. */
double tc_ref_label_mean(const tc_ref_label_cell *cell, double u, double tint[4]);
void tc_ref_label_tint(const tc_ref_label_cell *cell, double u, double rgb[3]);
double tc_ref_to_linear(double srgb);

/* pieces.c: cuts a stretch into monotone pieces between the values at which the transfer function is not smooth. */
typedef struct tc_ref_piece {
  const tc_ref_cell *cell;
  double from;        /* u of the front end, for reporting */
  double width;       /* in u */
  double mm;          /* length of u = 1 */
  double front, back; /* field values at the ends */
  double d[TC_REF_DEGREE]; /* value(from + x) = front + d[0] x + d[1] x^2 + ... for the cell's degree */
} tc_ref_piece;

typedef struct tc_ref_cutter {
  const tc_ref_cell *cell;
  const double *breaks;
  size_t n_breaks;
  double mm;
  double bend[TC_REF_DEGREE + 1]; /* u where monotone stretches end; the last is 1 */
  int n_bends, stretch;
  double u;          /* front end of the rest of this stretch */
  double value, end; /* the field there, and at the stretch's end */
  double d[TC_REF_DEGREE];
  bool fresh; /* a new stretch begins */
} tc_ref_cutter;

void tc_ref_cutter_start(tc_ref_cutter *cutter, const tc_ref_cell *cell, const double *breaks, size_t n_breaks);
/* Re-expands the polynomial c[0] + c[1] u + ... around u. */
void tc_ref_shift(double *c, int degree, double u);
bool tc_ref_cutter_next(tc_ref_cutter *cutter, tc_ref_piece *piece);

/* transfer.c: extinction and colour. */
typedef struct tc_ref_transfer {
  tc_knot *knots; /* [n], ascending, amounts clamped */
  size_t n;
  double *breaks; /* [n_breaks], strictly ascending: where extinction or colour is not smooth */
  size_t n_breaks;
  bool opacity, linear_light;
  double per_mm; /* 1 / unit distance */
} tc_ref_transfer;

/* The transfer function between two neighbouring knots, or beyond the ends. A piece lies in one span. */
typedef struct tc_ref_span {
  double base, inverse_width; /* fraction = (value - base) * inverse_width, 0..1 */
  double amount[2], clear[2]; /* opacity or extinction at the ends; 1 - opacity */
  double color[2][3];         /* sRGB */
  double per_mm;
  bool opacity, linear_light;
  bool no_extinction, one_extinction, one_color;
} tc_ref_span;

bool tc_ref_transfer_set_up(tc_ref_transfer *transfer, const tc_transfer_function *from, bool linear_light);
void tc_ref_transfer_clear(tc_ref_transfer *transfer);
/* The span just above a value. */
void tc_ref_span_above(const tc_ref_transfer *transfer, double value, tc_ref_span *span);
/* True if extinction is known to be 0 all over [lo, hi]. */
bool tc_ref_transfer_empty(const tc_ref_transfer *transfer, double lo, double hi);
double tc_ref_span_extinction(const tc_ref_span *span, double fraction);
double tc_ref_to_linear(double srgb);
void tc_ref_span_color(const tc_ref_span *span, double fraction, double rgb[3]);

/* projection.c: extrema and integral of the field along a ray, and the window that makes them grey (compositing
 * space). */
typedef struct tc_ref_extent {
  double lo, hi;           /* INFINITY and -INFINITY before the first cell */
  double integral, length; /* over mm */
} tc_ref_extent;

typedef struct tc_ref_window {
  double center, width;
  bool linear_light;
} tc_ref_window;

/* Of a cell with gaps among its corners, what is visible by at least half counts, to 1/64 of the stretch. */
void tc_ref_extent_add(tc_ref_extent *extent, const tc_ref_cell *cell);
double tc_ref_window_grey(const tc_ref_window *window, double value);

/* gradient.c: gradient over index coordinates at x (0..1) in the cell above `low`; 0 along an axis of one voxel. around: of
 * that cell, read if it is not yet. */
void tc_ref_gradient(const tc_ref_field *field, tc_gradient kind, const size_t low[3], tc_ref_around *around, const double x[3],
                     double g[3]);

/* shading.c: colour under light. model TC_SHADING_NONE: nothing is shaded, and the other members are meaningless. */
typedef struct tc_ref_shading {
  tc_shading_model model;
  tc_gradient gradient;
  double dual[3][3]; /* [k]: LPS gradient of index coordinate k, 1/mm */
  double per_range;  /* least spacing / value range */
  double ambient, diffuse, specular, shininess;
  int n_lights;
  struct {
    bool at_camera;
    double to[3], color[3]; /* unit, LPS; compositing space, times the intensity */
  } lights[TC_MAX_LIGHTS];
  double view[3];  /* unit, LPS: along the ray; set for each ray */
} tc_ref_shading;

void tc_ref_shading_set_up(tc_ref_shading *shading, const tc_volume *volume, const tc_scene *scene);
/* The scene's lights of meshes, where it has such, instead. */
void tc_ref_shading_light(tc_ref_shading *shading, const tc_scene *scene);
/* Replaces the transfer function's colour at u of the cell by the shaded one. */
void tc_ref_shade(const tc_ref_shading *shading, const tc_ref_cell *cell, double u, double rgb[3]);

/* The same with a surface's gradient over index coordinates: shaded in full however faint. *normal: unit, LPS, on the
 * eye's side; 0 where the field is flat. */
void tc_ref_shade_surface(const tc_ref_shading *shading, const double gradient[3], double normal[3], double rgb[3]);
/* The same with a normal of any length. */
void tc_ref_shade_normal(const tc_ref_shading *shading, double normal[3], double rgb[3]);

/* isosurface.c: where the field along the ray changes sides of the value (inside: >= value), after `skip` such places; *leaves:
 * whether it was inside before. False when it never does. */
bool tc_ref_surface_hit(const tc_ref_field *field, const tc_ref_ray *ray, double value, int skip, bool *leaves, double *t);
/* The linear field there, over index coordinates; false: in a cell with a gap. */
bool tc_ref_value_at(const tc_ref_field *field, const double at[3], double *value);
/* Over index coordinates. TC_GRADIENT_CELL: from the corners of the cube of two voxels around the place, held within
 * the volume. */
void tc_ref_surface_gradient(const tc_ref_field *field, tc_gradient kind, const double at[3], double gradient[3]);

/* quadrature.c: adds one piece behind what was met so far. */
typedef struct tc_ref_light {
  double color[3], transparency;
  double opacity; /* summed for itself: keeps its digits where 1 - transparency has none */
} tc_ref_light;

/* shading: NULL for none. */
void tc_ref_integrate(const tc_ref_piece *piece, const tc_ref_span *span, const tc_ref_shading *shading,
                      double tolerance, tc_ref_light *light);

#endif
