/* The reference integrator: the rendering integral along a ray in double precision, without a step.
 *
 * It judges every other renderer and therefore shares nothing with them: it has its own camera, field, transfer
 * function and integration (NUMERICS section 1). A ray is split at every cell face, at every extremum of the field
 * along it and wherever the field crosses a knot's value; each smooth piece in between is integrated adaptively.
 * Shading (raycast/shading.h) changes the colour at each point of the ray, with the scene's gradient there.
 *
 * For mip, minip and average, the reference is the exact extremum or mean of the field along the ray, through the
 * scene's window. For isosurface, it is the first point where the ray changes sides (raycast/isosurface.h), as the exact
 * root of the cubic, with the normal that isosurface.h defines. For mesh it is all such points, front to back, of surfaces
 * of values; of labels those of the smoothed signed distance that defines them (label_surface.c); of meshes those of the
 * triangles it is given; of planes those where they are. A volume around surfaces is integrated from one to the next.
 *
 * The reference is the limit of dvr as the step goes to 0, with the scene's filter: classification, order, sampling
 * (step, jitter, early ray termination, rays per pixel) and empty-space skipping are ignored. Immutable once made:
 * any number of threads may ask for pixels at once. */
#ifndef TC_REFERENCE_H
#define TC_REFERENCE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "renderer/base/error.h"
#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_reference tc_reference;

/* Triangles: the truth of surfaces that no field has. Only read while the reference is made. */
typedef struct tc_reference_mesh {
  double origin[3]; /* LPS mm */
  size_t n_vertices, n_triangles;
  const float (*positions)[3], (*normals)[3]; /* relative to the origin; normals NULL: the triangles' own */
  const uint32_t (*triangles)[3];
  const uint32_t *colors; /* [n_vertices] sRGB, red in the lowest byte; NULL: of a surface without a colour isosurface.color */
} tc_reference_mesh;

/* JSON pointer to the member because of which this scene has no reference; NULL if it has one. "/labels/volume": the
 * scene needs its label volume; "/mesh/surfaces": what its surfaces are of, labels or meshes (tc_reference_request). Pure. */
const char *tc_reference_missing(const tc_scene *scene);

/* What a reference is made of. */
typedef struct tc_reference_request {
  tc_volume *volume; /* sealed */
  tc_volume *labels; /* scene->labels.volume, checked as tc_labels_check() does (classify/labels.h); NULL: without */
  const tc_reference_mesh *meshes; /* [scene->mesh.n_surfaces], of the surfaces of meshes; NULL: without */
  const tc_scene *scene;
  int width, height;
  double tolerance;          /* absolute error bound of each channel of a pixel, 1e-14 .. 0.1; 0 = 1e-10 */
  const atomic_bool *cancel; /* once true (set from any thread) calls return soon, with meaningless results; must
                                outlive the reference; NULL: never */
} tc_reference_request;

/* Takes references on the volumes and copies what it needs of the rest. The prefiltered cubic filter allocates eight
 * bytes per voxel. Errors: TC_ERROR_CANCELLED; TC_ERROR_UNSUPPORTED with a pointer to a member that has no reference (a
 * mode other than dvr, mip, minip, average, isosurface; isosurfaces with another filter than linear; labels without
 * their volume); TC_ERROR_INVALID for a meaningless camera, transfer function or window. */
tc_reference *tc_reference_make(const tc_reference_request *request, GError **error);
/* The reference of a scene without labels and meshes. */
tc_reference *tc_reference_new(tc_volume *volume, const tc_scene *scene, int width, int height, double tolerance,
                               GError **error);
void tc_reference_free(tc_reference *reference); /* NULL is fine */

/* One ray. px, py: pixels from the top left corner of the picture (the centre of pixel i is i + 0.5; any real number
 * is valid). rgba: premultiplied colour in the compositing space (display sRGB, or linear light if the scene says
 * so), and opacity. Projections: grey, and opacity 1 where the ray meets the volume. */
void tc_reference_pixel(const tc_reference *reference, double px, double py, double rgba[4]);

/* All pixel centres, rgba[height][width][4], on `threads` threads (0 = one per online core). */
bool tc_reference_image(const tc_reference *reference, int threads, float *rgba, GError **error);

/* Where a ray of mode isosurface, or mesh of surfaces of values, meets the nearest surface. */
typedef struct tc_reference_hit {
  double position[3]; /* LPS mm */
  double distance_mm; /* from the eye */
  double normal[3];   /* LPS, unit, on the eye's side; 0 where the field is flat */
  double color[3];    /* shaded, compositing space */
  int surface;        /* number in scene->mesh.surfaces; 0 where the scene lists none */
  uint32_t label;     /* of the labels that it is the surface of; 0: of none */
} tc_reference_hit;

/* False if the ray misses the surface, or the mode is not isosurface. */
bool tc_reference_surface(const tc_reference *reference, double px, double py, tc_reference_hit *hit);

/* mm from the eye to the surfaces that a ray meets, front to back, as far as more than a 4096th of the light behind is seen
 * through those before. Returns their number, at most `most`. */
int tc_reference_layers(const tc_reference *reference, double px, double py, double *distance_mm, int most);

/* The verbose pixel: one entry per smooth piece of a ray, front to back. Within a piece the field is a polynomial
 * that crosses no knot. Transparent pieces are listed too. For an isosurface: the pieces in front of it, then the
 * hit, with length 0 and its colour. */
typedef struct tc_reference_sample {
  double position[3];       /* LPS mm of the piece's front end */
  double distance_mm;       /* from the eye */
  double length_mm;         /* of the piece */
  double value, value_back; /* field at the front and back end, volume's unit */
  double color[3];          /* at the front end, shaded, compositing space */
  double extinction;        /* at the front end, 1/mm; at a jump the limit from inside the piece; 0 in a projection */
  double transparency;      /* of everything in front of the piece; 1 at the first */
} tc_reference_sample;

/* *samples: g_free() it; NULL, and *count 0, if the ray misses the volume. */
void tc_reference_ray(const tc_reference *reference, double px, double py, tc_reference_sample **samples,
                      size_t *count);

#endif
