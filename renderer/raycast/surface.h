/* An isosurface, the same numbers for every back end: where a ray meets it and what it looks like.
 *
 * Inside is where the trilinear field is at or above isosurface.value; the surface is where a ray, on its way from its
 * entry (eye, volume or clip plane), goes from inside to outside or the other way for the first time. A clip plane, the
 * volume's own faces and a camera in the midst of it therefore open the surface: it is seen as a hollow shell, as VTK
 * shows it, and a field that is all of one side has none. It is opaque.
 *
 * Rays do not step: they go from cell to cell. In each cell whose corners are not all on the side where the ray began,
 * the field along the ray is a cubic; between its extrema it is monotone, so the first change of side is bracketed
 * without fail and refined to the accuracy of single precision (Marmitt et al., Fast and accurate ray-voxel
 * intersection techniques, VMV 2004). Nothing thin is missed, sampling.step has no meaning, and the cost is about that
 * of one sample a voxel.
 *
 * The normal at the hit is from the trilinear field at the eight corners of the cube of two voxels around it (held
 * within the volume): differences between opposite faces, each the mean of its corners. It has none of the facets of
 * the field's own gradient and little of the terraces and noise that central differences show. shade.h takes it to LPS;
 * the weight of flat places is left out, because a surface is a surface however faint. */
#ifndef TC_RAYCAST_SURFACE_H
#define TC_RAYCAST_SURFACE_H

#include "renderer/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_surface {
  float iso, scale;    /* w = (voxel - iso) * scale is in -1..1 and >= 0 inside, whatever the slope's sign */
  double below, above; /* a block with all of its voxels < below or all > above holds none of it, rounding included */
  float color[3];      /* compositing space */
} tc_surface;

/* Modes that show it: cast, or as a mesh. */
bool tc_is_surface(tc_mode mode);

/* False where no ray can change sides: the value is not above the least and at most the greatest of the volume. */
bool tc_surface_exists(const tc_volume *volume, const tc_scene *scene);

/* isosurface.value is finite (tc_plan_make). Pure. */
tc_surface tc_surface_make(const tc_volume *volume, const tc_scene *scene);

#endif
