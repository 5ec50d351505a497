/* Isosurfaces: where a ray meets one and how it is shaded, the same numbers for every back end.
 *
 * Inside is where the trilinear field is at or above isosurface.value. A ray hits the surface where it first changes
 * sides, either way, after its entry (at the eye, the volume's face or a clip plane). A clip plane, the volume's faces
 * and a camera inside therefore open the surface, which is seen as a hollow shell, as in VTK; a field that is all on
 * one side has no surface. It is opaque.
 *
 * Rays do not step, they walk from cell to cell. Within a cell the field along the ray is a cubic. In each cell whose
 * corners are not all on the side where the ray began, the cubic is cut at its extrema into monotone parts; the first
 * change of side is thereby bracketed without fail, and refined to single precision (Marmitt et al., Fast and accurate
 * ray-voxel intersection techniques, VMV 2004). Nothing thin is missed, sampling.step has no effect, and the cost is
 * about one sample per voxel.
 *
 * The normal at the hit comes from the trilinear field at the eight corners of a cube two voxels wide around it
 * (clamped to the volume): differences between opposite faces, each the mean of its corners. It has none of the
 * facets of the cell's own gradient and few of the terraces and little of the noise that central differences show.
 * shading.h transforms it to LPS and shades it at full weight, because a surface is a surface however faint. */
#ifndef TC_RAYCAST_ISOSURFACE_H
#define TC_RAYCAST_ISOSURFACE_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_surface {
  float iso, scale;    /* w = (voxel - iso) * scale is in -1..1 and >= 0 inside, whatever the slope's sign */
  double below, above; /* a block with all voxels < below, or all > above, does not contain the surface, rounding included */
  float color[3];      /* compositing space */
} tc_surface;

/* Modes that show an isosurface: cast, or as a mesh. */
bool tc_is_surface(tc_mode mode);

/* False if no ray can change sides: the value is not in (minimum, maximum] of the volume. */
bool tc_surface_exists(const tc_volume *volume, const tc_scene *scene);

/* The scene was validated: isosurface.value is finite. Pure. */
tc_surface tc_surface_make(const tc_volume *volume, const tc_scene *scene);

#endif
