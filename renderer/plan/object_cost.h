/* What a solid object of a threshold costs to draw, in each of the modes that can: milliseconds of a frame of the cpu
 * whose resources are there, by a model linear in what a few rays find. Each ray of a coarse grid over the picture
 * walks through the volume and counts its steps and the surfaces it crosses: crossings tell how much surface is in the
 * picture (Crofton), which splats and triangles pay for, steps what rays pay for. Coefficients were fitted to measured
 * frames (tomocast bench --objects) of one machine; another, its threads and instruction set give each mode a factor,
 * which the renderer measures once (frame/object_speed.h). */
#ifndef TC_PLAN_OBJECT_COST_H
#define TC_PLAN_OBJECT_COST_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef enum tc_object_mode { TC_OBJECT_SPLAT, TC_OBJECT_ISOSURFACE, TC_OBJECT_MESH, TC_OBJECT_MODES } tc_object_mode;

/* What costs are linear in. Kilopixels, thousands of voxels. */
typedef enum tc_object_term {
  TC_TERM_FRAME,   /* 1 */
  TC_TERM_PIXELS,  /* of the picture */
  TC_TERM_RAYS,    /* pixels over the volume */
  TC_TERM_STEPS,   /* voxels that their rays pass until they hit */
  TC_TERM_NEAR,    /* of those, such as have a surface within a block of them, where rays do not leap */
  TC_TERM_HITS,    /* pixels over the object */
  TC_TERM_SURFACE, /* voxels of surface within the picture's pyramid, hidden or not */
  TC_TERM_SEEN,    /* of those, the nearest */
  TC_TERM_APART,   /* voxels near a surface, times how many lie between two rays: neighbours then share no memory */
  TC_TERM_COUNT
} tc_object_term;

typedef struct tc_object_cost {
  double terms[TC_TERM_COUNT];
  double ms[TC_OBJECT_MODES];
  tc_object_mode cheapest;
} tc_object_cost;

/* Whether all that a scene shows is one opaque object of a threshold: mode splat (from its lower threshold on),
 * isosurface or mesh (from its value on), without labels, over a volume with a grid. */
bool tc_is_object(const tc_volume *volume, const tc_scene *scene);

/* False: it is no such object. speed: what the milliseconds of each mode are multiplied by; NULL: 1. A
 * few milliseconds. Pure. */
bool tc_object_cost_of(const tc_volume *volume, const tc_scene *scene, int width, int height,
                       const double speed[TC_OBJECT_MODES], tc_object_cost *cost);

tc_mode tc_object_mode_of(tc_object_mode mode);

#endif
