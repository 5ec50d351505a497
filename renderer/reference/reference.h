/* The reference integrator: the rendering integral of one ray in double precision, without a step.
 *
 * It judges every other renderer, so it shares nothing with them: its own camera, field, transfer function and
 * integration (NUMERICS section 1). A ray is split at every cell face, at every extremum of the field along it and at
 * every crossing of a knot's value; what is left between two splits is smooth and is integrated adaptively.
 *
 * For mip, minip and average it is the exact extremum or mean of the field along the ray, through the scene's window.
 * Shading (raycast/shade.h) acts on the colour at each point of the ray, with the scene's gradient there.
 *
 * For isosurface it is the first place where the ray changes sides (raycast/surface.h), the exact root of the cubic,
 * with the normal that surface.h gives it there.
 *
 * It stands for what dvr converges to as the step goes to 0, by the scene's filter: classification, order, sampling
 * (step, jitter, termination, rays per pixel) and skipping of the scene are therefore ignored. Immutable once made: any
 * number of threads may ask for pixels at once. */
#ifndef TC_REFERENCE_H
#define TC_REFERENCE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>

#include "renderer/error.h"
#include "renderer/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_reference tc_reference;

/* Pointer to the member for which this scene has no reference, NULL where it has one. "/labels/volume": none without
 * the label volume itself (tc_reference_new_labelled). Pure. */
const char *tc_reference_missing(const tc_scene *scene);

/* Takes a reference on the sealed volume and copies what it needs of the scene. tolerance: absolute bound wanted on
 * each channel of a pixel, 1e-14 .. 0.1; 0 = 1e-10. A prefiltered cubic takes eight bytes a voxel. Errors:
 * TC_ERROR_UNSUPPORTED with a pointer to the member for what has no reference (a mode other than dvr, mip, minip,
 * average, isosurface; a filter of isosurfaces but linear, labels without their volume); TC_ERROR_INVALID for a camera,
 * transfer function or window (whichever the mode reads) without meaning. */
tc_reference *tc_reference_new(tc_volume *volume, const tc_scene *scene, int width, int height, double tolerance,
                               GError **error);
/* With the volume that scene->labels.volume names (classify/labels.h says what it does; checked by the caller as
 * tc_labels_check does), another reference of which is taken; NULL: as above. */
tc_reference *tc_reference_new_labelled(tc_volume *volume, tc_volume *labels, const tc_scene *scene, int width,
                                        int height, double tolerance, GError **error);
/* The same; once *cancel is true (set from any thread; outlives the reference) nothing more is integrated: what is under
 * way ends soon with what it has, which means nothing. TC_ERROR_CANCELLED where that comes first. */
tc_reference *tc_reference_new_stoppable(tc_volume *volume, tc_volume *labels, const tc_scene *scene, int width,
                                         int height, double tolerance, const atomic_bool *cancel, GError **error);
void tc_reference_free(tc_reference *reference); /* NULL is fine */

/* One ray. px, py: pixels from the top left corner of the picture (pixel i's centre is i + 0.5; any real number is a
 * ray). rgba: premultiplied colour in the compositing space (display sRGB, or linear light where the scene asks), and
 * opacity. A projection: grey, and 1 where the ray meets the volume. */
void tc_reference_pixel(const tc_reference *reference, double px, double py, double rgba[4]);

/* All pixel centres, rgba[height][width][4], on `threads` threads (0 = one per online core). */
bool tc_reference_image(const tc_reference *reference, int threads, float *rgba, GError **error);

/* Where a ray of mode isosurface meets the surface. */
typedef struct tc_reference_hit {
  double position[3]; /* LPS mm */
  double distance_mm; /* from the eye */
  double normal[3];   /* LPS, unit, on the eye's side; 0 where the field is flat */
  double color[3];    /* shaded, compositing space */
} tc_reference_hit;

/* False: the ray meets none, or the mode is another. */
bool tc_reference_surface(const tc_reference *reference, double px, double py, tc_reference_hit *hit);

/* The verbose pixel: one entry per smooth piece of a ray, front to back. Between the entries' positions the field is a
 * polynomial that meets no knot. Pieces in which nothing is emitted or absorbed are listed too. Of an isosurface: the
 * pieces in front of it, then, of length 0 and in its colour, the hit. */
typedef struct tc_reference_sample {
  double position[3];       /* LPS mm of the piece's front end */
  double distance_mm;       /* from the eye */
  double length_mm;         /* of the piece */
  double value, value_back; /* field at the front and back end, volume's unit */
  double color[3];          /* at the front end, shaded, compositing space */
  double extinction;        /* at the front end, 1/mm; at a jump the limit from inside the piece; 0 in a projection */
  double transparency;      /* of all that lies before the piece, 1 at the first */
} tc_reference_sample;

/* *samples: g_free() it; NULL with *count 0 when the ray misses the volume. */
void tc_reference_ray(const tc_reference *reference, double px, double py, tc_reference_sample **samples,
                      size_t *count);

#endif
