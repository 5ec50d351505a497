/* Planar reformats (mode mpr): slices and slabs as parallel rays, one per pixel, anchored on the plane. scene.mpr
 * (scene.h) defines the planes. */
#ifndef TC_RAYCAST_MPR_H
#define TC_RAYCAST_MPR_H

#include "renderer/raycast/rays.h"

/* Unit vectors in LPS: to the right of the picture, to its top, away from the viewer. The scene was validated. Pure. */
void tc_slice_basis(const tc_scene *scene, double right[3], double up[3], double into[3]);

/* Sets up the rays of a slice or slab. s = 0 is the plane; eye_mm and far_mm are half the thickness, or almost 0 for a
 * single slice, which is sampled at the entry of its rays. The index box and the clipped space are enlarged by a
 * thousandth of a voxel, so that rounding never drops a voxel that lies exactly on a face. Pure. */
void tc_slice_rays(tc_rays *rays, const tc_volume *volume, const tc_scene *scene, int width, int height);

typedef struct tc_slice_hit {
  double position[3]; /* LPS mm: of a slab's maximum or minimum; for an average the middle of what is seen of the slab */
  double value;       /* trilinear, in the volume's unit */
  double depth_mm;    /* from the slab's face towards the viewer; 0 on a slice */
} tc_slice_hit;

/* What a pixel of a slice or slab shows; at: pixels, (0, 0) at the top left corner of a picture of the scene's size. False: nothing
 * (outside the volume, clipped, or in a gap). Pure. */
bool tc_slice_pick(const tc_volume *volume, const tc_scene *scene, const double at[2], tc_slice_hit *hit);

#endif
