/* The state of the integrator, and its surfaces' hits; private to this folder. */
#ifndef TC_REFERENCE_INTEGRATOR_H
#define TC_REFERENCE_INTEGRATOR_H

#include "renderer/reference/internal.h"
#include "renderer/reference/reference.h"

/* A surface of the scene: in modes isosurface and mesh, and of a mesh drawn inside a volume. */
typedef struct tc_ref_surface {
  tc_surface_source kind;
  int number;     /* index in the scene's list */
  uint32_t label; /* 0: the surface is not a label's */
  double iso, plane[4];
  tc_ref_triangles *triangles;   /* of a mesh; owned */
  tc_ref_field field;            /* of a label; `smooth` is owned, NULL if no voxel has the label */
  double color[3], opacity;      /* compositing space */
  bool one_sided, colored;       /* colored: the triangles have colours of their own */
  tc_ref_shading shading;
} tc_ref_surface;

struct tc_reference {
  tc_volume *volume;
  tc_ref_camera camera;
  tc_ref_clip clip;
  tc_ref_field field;
  tc_ref_transfer transfer; /* dvr */
  tc_ref_shading shading;   /* dvr */
  tc_mode mode;
  tc_ref_window window;    /* projections */
  tc_volume *label_volume; /* or NULL */
  tc_volume *labelled;     /* label volume of the surfaces, or NULL */
  tc_scene scene;          /* the members that labels need; zero without labels */
  tc_ref_labels labels;
  tc_ref_surface *surfaces; /* [n_surfaces] */
  size_t n_surfaces;
  bool within; /* the volume is drawn too, around the surfaces */
  double tolerance;
  const atomic_bool *cancel; /* or NULL */
};

static inline bool tc_ref_is_projection(tc_mode mode) {
  return mode == TC_MODE_MIP || mode == TC_MODE_MINIP || mode == TC_MODE_AVERAGE;
}

static inline bool tc_ref_stopped(const tc_reference *r) {
  return r->cancel && atomic_load_explicit(r->cancel, memory_order_relaxed);
}

/* The reference of mode mesh is the exact surface of the field, not the triangles. */
static inline bool tc_ref_is_surface(tc_mode mode) { return mode == TC_MODE_ISOSURFACE || mode == TC_MODE_MESH; }

static inline void tc_ref_cast_pixel(const tc_reference *r, double px, double py, tc_ref_cast *ray) {
  tc_ref_ray_cast(&r->camera, &r->clip, r->field.desc, px, py, ray);
}

/* The next hit of a ray and a surface. */
typedef struct tc_ref_next_hit {
  tc_reference_hit hit;
  double t;
  int skip;
  bool met;
  bool bound; /* t is only a lower bound; tc_ref_hit_surface() finds the hit */
  const tc_ref_field *field; /* of surfaces of values and labels: the field of the hit */
  double at[3];              /* the hit, index units of that field */
} tc_ref_next_hit;

/* hits.c; next: [n_surfaces], all zero before tc_ref_begin_hits(). */
/* The first hit of each surface. Of a label's surface, whose field is expensive, only a lower bound of t. */
void tc_ref_begin_hits(const tc_reference *r, const tc_ref_cast *cast, tc_ref_next_hit *next);
/* Index of the surface that is hit next; n_surfaces: none. */
size_t tc_ref_find_nearest(const tc_reference *r, const tc_ref_cast *cast, tc_ref_next_hit *next);
/* Advances to the surface's next hit; false: there is none. */
bool tc_ref_hit_surface(const tc_reference *r, const tc_ref_surface *s, const tc_ref_cast *cast, tc_ref_next_hit *next);
/* The nearest first hit of all surfaces, and its surface; NULL: none. */
const tc_ref_surface *tc_ref_hit_nearest(const tc_reference *r, const tc_ref_cast *cast, tc_reference_hit *hit);

#endif
