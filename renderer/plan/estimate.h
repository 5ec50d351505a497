/* Cost of a frame, estimated before it is drawn. */
#ifndef TC_PLAN_ESTIMATE_H
#define TC_PLAN_ESTIMATE_H

#include "renderer/mesh/mesh.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

/* Upper bound on the samples of a frame of width x height pixels, without empty-space skipping and early ray
 * termination: pixels whose rays can meet the volume, times rays per pixel, times samples per ray (length inside the
 * volume over the step, plus a few at the ends and, in mip and minip, around the peak). *longest_ray, unless NULL: the
 * bound for the longest ray alone. Infinite, or 0 (nothing to draw), for a scene that tc_plan_check() refuses. Pure;
 * some 20 microseconds; any thread.
 *
 * The unit is one trilinear sample: eight voxels fetched and interpolated. A sample counts 1 with filters nearest and
 * linear, and 8 with cubic (64 voxels). A segment of dvr counts one sample; preintegrated2 adds a second one, labels
 * add one, shading by central gradients adds 4 (32 voxels), by cubic gradients 8. An isosurface has no steps: its rays
 * count the cells that they traverse, and nothing else. For meshes and splats the result is an estimate instead of a
 * bound, because their numbers are not known in advance. A mesh counts one sample for each ray of the pixels that it
 * may cover. Meshes of the scene's own (`meshes`, [surfaces of scene.mesh]; NULL: none), drawn alone or within the
 * volume, count the area that their triangles cover (mesh/coverage.h); a translucent one counts LAYER samples per
 * layer, because all layers are sorted. Splats count the cost of a surface of typical size and of the pixels of the
 * picture.
 *
 * The estimate is proportional to the pixels of the picture; to 1 / sampling.step (except for the samples at the ends;
 * isosurfaces not at all); in projections and isosurfaces to sampling.raysPerPixel (the rays of dvr share a pixel's
 * samples: more rays add only samples at the ends); and in mpr to mpr.thickness. Messages that propose a smaller scene
 * rely on this. */
double tc_estimate_samples(const tc_volume *volume, const tc_scene *scene, tc_mesh *const *meshes, int width, int height,
                           double *longest_ray);

/* Cost of a frame relative to other frames of the same look, in pixels: the geometric mean of its pixels and of its
 * samples at step 1, where 256 samples count as one pixel. Neither number alone predicts times while the camera zooms:
 * close views end more rays early, and pixels outside the volume cost next to nothing. Pure; any thread. */
double tc_estimate_pixels(const tc_volume *volume, const tc_scene *scene, int width, int height);

#endif
