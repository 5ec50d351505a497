/* Ray setup: the rays of a camera through a volume, and their clipping, the same for every back end.
 *
 * A ray is anchored near the volume instead of at the eye, so that single precision suffices for a distant camera:
 * p(s) = anchor(i,j) + s * dir(i,j), s in mm from the anchor.
 *   anchor(i,j) = anchor0 + (i+0.5) * anchor_du + (j+0.5) * anchor_dv         index (voxel) coordinates
 *   view(i,j)   = view0   + (i+0.5) * view_du   + (j+0.5) * view_dv           LPS mm, eye -> anchor (perspective)
 *   dir(i,j)    = to_index * view / |view|                                    voxels per mm
 * Pixel (0,0) is top left (NUMERICS section 0). The eye is at s = -|view| (perspective) or s = -eye_mm
 * (orthographic, where view is constant and of unit length): nothing in front of the eye plane or beyond s = far_mm is
 * visible. Clip planes shorten the ray further; its first sample then lies exactly on the plane, so that a cut face has
 * no artefacts. The field is sampled at t0 + i * step_mm, where t0 is the ray's entry into the clipped index box. A ray
 * with a phase below 1 (subpixel.h) takes sample i earlier by (1 - phase) * step_mm, but not before the entry. */
#ifndef TC_RAYCAST_RAYS_H
#define TC_RAYCAST_RAYS_H

#include "renderer/raycast/subpixel.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

#define TC_MAX_CLIP_PLANES 12 /* the six faces of a clip box, and six clip planes */

typedef struct tc_rays {
  int width, height; /* of the picture, pixels */
  double anchor0[3], anchor_du[3], anchor_dv[3];
  double view0[3], view_du[3], view_dv[3];
  double to_index[9]; /* row by row */
  double eye_mm;      /* orthographic only */
  double far_mm;      /* rays end here at the latest; TC_RAYS_FAR_MM except for slices */
  bool perspective;
  double lo[3], hi[3]; /* index box of the field */
  double step_mm;      /* length of a full segment: tc_rays_step_mm() */
  int count;           /* rays per pixel */
  tc_subpixel of_pixel[TC_MAX_RAYS_PER_PIXEL]; /* [count] */
  double footprint;    /* bound, in voxels along any axis, of the distance between a ray and its pixel's centre ray at the same s
                          inside the volume; infinite where pixels are too wide for a bound */
  double planes[TC_MAX_CLIP_PLANES][4]; /* planes[i] . (index position, 1) = mm from clip plane i; visible where >= 0 */
  int n_planes;
} tc_rays;

/* tc_rays in single precision, for kernels and shaders: the layout of the structure Rays of head.glsl (std140), hence
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

/* Length of a full segment of a ray. In dvr the R rays of a pixel share the samples: the steps of each are R times as
 * long. In projections every ray takes all samples, because fewer would miss extrema. */
double tc_rays_step_mm(const tc_volume *volume, const tc_scene *scene);

/* The scene was validated (tc_plan_check). width, height: of the picture in pixels. Pure. */
void tc_rays_set_up(tc_rays *rays, const tc_volume *volume, const tc_scene *scene, int width, int height);

/* Rounds to single precision; unused members are zero. */
void tc_rays_round(tc_rays_single *to, const tc_rays *rays);

#endif
