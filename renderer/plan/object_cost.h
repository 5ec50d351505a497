/* Cost model of drawing a solid object (all voxels over a threshold) in modes splat, isosurface and mesh: milliseconds of a
 * cpu frame whose resources are built, linear in the terms below. A coarse grid of rays over the picture counts steps and
 * crossings of the surface. Steps predict the cost of rays; the number of crossings gives the area of the surface (Crofton's
 * formula), which predicts the cost of splats and triangles. The coefficients were fitted to frames measured on one machine
 * (tomocast bench --objects); for other machines, thread counts and instruction sets the renderer measures one factor a
 * mode (frame/object_speed.h). */
#ifndef TC_PLAN_OBJECT_COST_H
#define TC_PLAN_OBJECT_COST_H

#include <stdatomic.h>

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef enum tc_object_mode { TC_OBJECT_SPLAT, TC_OBJECT_ISOSURFACE, TC_OBJECT_MESH, TC_OBJECT_MODES } tc_object_mode;

/* Terms of the model, in thousands of pixels or voxels. */
typedef enum tc_object_term {
  TC_TERM_FRAME,   /* 1 */
  TC_TERM_PIXELS,  /* pixels of the picture */
  TC_TERM_RAYS,    /* pixels whose rays meet the volume */
  TC_TERM_STEPS,   /* voxels that rays pass before a hit */
  TC_TERM_NEAR,    /* voxels of TC_TERM_STEPS within one block of a surface, where rays cannot leap */
  TC_TERM_HITS,    /* pixels whose rays hit the object */
  TC_TERM_SURFACE, /* surface voxels inside the view frustum, visible or hidden */
  TC_TERM_SEEN,    /* visible surface voxels */
  TC_TERM_APART,   /* TC_TERM_NEAR times the voxels between two neighbouring rays, which then share no cache lines */
  TC_TERM_COUNT
} tc_object_term;

typedef struct tc_object_cost {
  double terms[TC_TERM_COUNT];
  double ms[TC_OBJECT_MODES];
  tc_object_mode cheapest;
} tc_object_cost;

/* True if the scene shows exactly one opaque object (mode splat, isosurface or mesh, without labels) of a volume with a
 * grid; the threshold is splat.threshold's lower end, or the iso value. */
bool tc_is_object(const tc_volume *volume, const tc_scene *scene);

/* False: the scene is no such object, nothing of it is in view, or *cancel became true. Takes a few milliseconds. cancel: may be NULL. */
bool tc_object_cost_of(const tc_volume *volume, const tc_scene *scene, int width, int height, const atomic_bool *cancel,
                       tc_object_cost *cost);
/* Multiplies the milliseconds of each mode by its factor and finds the cheapest mode again. */
void tc_object_cost_scale(tc_object_cost *cost, const double speed[TC_OBJECT_MODES]);

tc_mode tc_object_mode_of(tc_object_mode mode);

#endif
