/* Isosurfaces: ray-surface intersection and shading, with the same numbers for every back end.
 *
 * A point is inside if the trilinear field there is at or above isosurface.value. A ray hits the surface where it first
 * passes from inside to outside or back after its entry (at the eye, the volume's face or a clip plane). Clip planes,
 * the volume's faces and a camera inside therefore open the surface, which appears as a hollow shell, as in VTK; a
 * field that is entirely inside or outside has no surface. The surface is opaque.
 *
 * Rays do not step but traverse cells. Within a cell the field along the ray is a cubic. In each cell whose corners are
 * not all on the ray's present side, the cubic is split at its extrema into monotone parts, which brackets the first
 * change of side reliably; the bracket is refined to single precision (Marmitt et al., Fast and accurate ray-voxel
 * intersection techniques, VMV 2004). No thin structure is missed, sampling.step has no effect, and the cost is about
 * one sample per voxel.
 *
 * The normal at the hit comes from the trilinear field at the eight corners of a cube two voxels wide around the hit
 * (clamped to the volume): differences between opposite faces, each the mean of its corners. It shows none of the
 * facets of the cell's own gradient, and fewer terraces and less noise than central differences. shading.h transforms
 * it to LPS and shades at full weight, because a surface is lit however small its gradient. */
#ifndef TC_RAYCAST_ISOSURFACE_H
#define TC_RAYCAST_ISOSURFACE_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_surface {
  float iso, scale;    /* w = (voxel - iso) * scale is in -1..1 and >= 0 inside, whatever the slope's sign */
  double below, above; /* a block with all voxels < below, or all > above, does not contain the surface, rounding included */
  float color[3];      /* compositing space */
} tc_surface;

/* True for modes that show an isosurface: isosurface (ray cast) and mesh. */
bool tc_is_surface(tc_mode mode);

/* False if there is no surface: the iso value is not in (minimum, maximum] of the volume. */
bool tc_surface_exists(const tc_volume *volume, const tc_scene *scene);

/* The scene was validated: isosurface.value is finite. Pure. */
tc_surface tc_surface_make(const tc_volume *volume, const tc_scene *scene);

#endif
