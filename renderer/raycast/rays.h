/* From a camera to rays through a volume, the same for every back end.
 *
 * A ray is written around an anchor near the volume instead of around the eye, so that single precision holds for a
 * camera far away: p(s) = anchor(i,j) + s * dir(i,j), s in mm from the anchor.
 *   anchor(i,j) = anchor0 + (i+0.5) * anchor_du + (j+0.5) * anchor_dv         index (voxel) coordinates
 *   view(i,j)   = view0   + (i+0.5) * view_du   + (j+0.5) * view_dv           LPS mm, eye -> anchor (perspective)
 *   dir(i,j)    = to_index * view / |view|                                    voxels per mm
 * Pixel (0,0) is top left (NUMERICS section 0). The eye is at s = -|view| (perspective) or s = -eye_mm (orthographic,
 * where view is constant and of unit length): nothing in front of it is seen, and nothing beyond s = far_mm. Clip
 * planes cut the ray's stay further; its first sample then lies exactly on the plane, so a cut face has no halo. The
 * field is sampled at t0 + i * step_mm from the ray's entry t0 into the index box; a ray whose phase (subpixel.h) is
 * under 1 has its sample i earlier by (1 - phase) * step_mm, but none before the entry. */
#ifndef TC_RAYCAST_RAYS_H
#define TC_RAYCAST_RAYS_H

#include "renderer/raycast/subpixel.h"
#include "renderer/scene.h"
#include "renderer/volume/volume.h"

#define TC_MAX_CLIP_PLANES 12 /* a box's six faces and six planes of the scene's own */

typedef struct tc_rays {
  double anchor0[3], anchor_du[3], anchor_dv[3];
  double view0[3], view_du[3], view_dv[3];
  double to_index[9]; /* row by row */
  double eye_mm;      /* orthographic only */
  double far_mm;      /* where rays end at the latest; beyond any volume but for slices */
  bool perspective;
  double lo[3], hi[3]; /* index box of the field */
  double step_mm;      /* length of a full segment: tc_rays_step_mm() */
  int count;           /* rays a pixel */
  tc_subpixel of_pixel[TC_MAX_RAYS_PER_PIXEL]; /* the first `count` */
  double footprint;    /* no ray is further than this from its pixel's centre ray at the same s inside the volume, along any axis;
                          voxels. Infinite where pixels are too wide to say */
  double planes[TC_MAX_CLIP_PLANES][4]; /* what is drawn has planes[i] . (index position, 1) >= 0; mm from the plane */
  int n_planes;
} tc_rays;

/* The same in single precision, as kernels and shaders read it: laid out as the structure Rays of head.glsl (std140), hence
 * the unused fourth components. */
typedef struct tc_subpixel_single { float x, y, phase, unused; } tc_subpixel_single;
typedef struct tc_rays_single {
  float anchor0[4], anchor_du[4], anchor_dv[4];
  float view0[4], view_du[4], view_dv[4];
  float to_index[3][4];
  float lo[4], hi[4];
  float step_mm, inverse_step, eye_mm, far_mm;
  float planes[TC_MAX_CLIP_PLANES][4];
  tc_subpixel_single of_pixel[TC_MAX_RAYS_PER_PIXEL];
  int32_t n_planes, count, perspective;
  float footprint; /* at most 1e9 */
} tc_rays_single;

#define TC_RAYS_FAR_MM 1e30

/* Length of a full segment of a ray: where rays composite, those of one pixel share the samples between them.
 * Projections would miss extremes between fewer samples: there every ray takes all. */
double tc_rays_step_mm(const tc_volume *volume, const tc_scene *scene);

/* The camera, or the plane of mode mpr, was validated (tc_plan_make). width, height: pixels of the picture to make.
 * Pure. */
void tc_rays_set_up(tc_rays *rays, const tc_volume *volume, const tc_scene *scene, int width, int height);

/* Rounds; members that do not count are zero. */
void tc_rays_round(tc_rays_single *to, const tc_rays *rays);

/* The scene's clip box and planes; part of setting up. */
void tc_rays_add_clipping(tc_rays *rays, const tc_volume *volume, const tc_scene *scene);

#endif
