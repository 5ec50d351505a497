/* What a frame would cost, before anything of it is drawn. */
#ifndef TC_PLAN_ESTIMATE_H
#define TC_PLAN_ESTIMATE_H

#include "renderer/mesh/mesh.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

/* An upper bound of the samples of a frame of width x height pixels, with nothing skipped and no ray ended early: pixels
 * whose rays can meet the volume, times rays a pixel, times the length of a ray inside over the step, and a few more a ray
 * for its ends and, in mip and minip, around its peak. *longest_ray, unless NULL: of the longest ray alone. Infinite, or 0
 * (nothing to draw), for a scene that tc_plan_check() refuses. Pure; some 20 microseconds; any thread.
 *
 * One is a trilinear sample: eight voxels fetched and mixed. A sample counts 1 by filters nearest and linear and 8 by
 * cubic (64 voxels). Every segment of dvr counts one sample; with preintegrated2 a second; with labels one more; shaded
 * by central gradients 4 more (32 voxels), by cubic ones 8. An isosurface has no steps: its rays count the cells they
 * pass, and nothing else. Meshes and splats are the exceptions: how many there are is not known before. A mesh counts
 * the samples of the pixels that it may cover once; meshes of a scene's own (`meshes`, at the places of its list of surfaces; NULL:
 * none), drawn alone or within the volume, count what their triangles cover (mesh/coverage.h), a translucent one LAYER
 * samples a layer, since all of its layers are sorted. Splats count what a surface of usual size costs, beside the
 * pixels that it covers.
 *
 * How the estimate falls, for a message that proposes a smaller scene: in proportion to the pixels of the picture, to 1 /
 * sampling.step (but for those of the ends; an isosurface's not at all), and, in the projections and isosurfaces, to
 * sampling.raysPerPixel (the rays of dvr share a pixel's samples: there it costs only their ends). In mpr in proportion
 * to mpr.thickness. */
double tc_estimate_samples(const tc_volume *volume, const tc_scene *scene, tc_mesh *const *meshes, int width, int height,
                           double *longest_ray);

/* What a frame takes beside others of the same look, in pixels: the geometric mean of its pixels and of the samples of
 * all its rays at a step of 1, 256 of which count as a pixel. Neither alone foretells times while the camera zooms: near
 * views hide more behind what is seen first, and pixels beside the volume cost next to nothing. Pure; any thread. */
double tc_estimate_pixels(const tc_volume *volume, const tc_scene *scene, int width, int height);

#endif
