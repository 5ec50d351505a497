/* Planar reformats (mode mpr) as parallel rays: one a pixel, anchored on the plane, along the view into the picture.
 * What the planes look like is said at scene.mpr (scene.h). */
#ifndef TC_RAYCAST_SLICE_H
#define TC_RAYCAST_SLICE_H

#include "renderer/raycast/rays.h"

/* Unit vectors in LPS: to the right of the picture, to its top, away from the viewer. The scene was validated. Pure. */
void tc_slice_basis(const tc_scene *scene, double right[3], double up[3], double into[3]);

/* The rays of a slice or slab. s = 0 is the plane; eye_mm and far_mm are half the thickness, and next to nothing for
 * one slice, which is sampled where its rays begin. The index box and the clipped space are a thousandth of a voxel
 * larger than the field's, so that rounding never blanks a voxel that lies exactly in a face. Pure. */
void tc_slice_rays(tc_rays *rays, const tc_volume *volume, const tc_scene *scene, int width, int height);

#endif
