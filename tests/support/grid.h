/* Procedural volumes and bare scenes for tests. A failure ends the test program, since it is the test's own error. */
#ifndef TC_TEST_GRID_H
#define TC_TEST_GRID_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"
#include "tests/support/scoped.h"

/* Zero members default to: spacing 1 mm, origin 0, direction identity, slope 1, intercept 0. */
typedef struct test_grid {
  int dims[3];
  tc_voxel_type type;
  double spacing[3], origin[3], direction[9], slope, intercept;
} test_grid;

/* The value (in the volume's unit) at voxel x, y, z. */
typedef double (*test_field)(double x, double y, double z, const void *context);

/* Makes a sealed volume: stores (value - intercept) / slope, rounded and clamped for integer types. */
tc_volume *test_volume(const test_grid *grid, test_field field, const void *context);

double test_constant(double x, double y, double z, const void *value);   /* const double * */
double test_linear(double x, double y, double z, const void *plane);     /* const double[4]: a x + b y + c z + d */
double test_radius2(double x, double y, double z, const void *center);   /* const double[3]: squared distance */
double test_waves(double x, double y, double z, const void *wavelength); /* const double *: smooth, within 0..1 */
double test_noise(double x, double y, double z, const void *seed); /* const unsigned *: 0..1, independent per voxel */

/* Uniform 0..1 from a 64-bit state. */
double test_random(uint64_t *state);

/* A dvr scene without early termination, step 1, of width x height pixels. */
void test_scene(tc_scene *scene, int width, int height);
/* A transfer function of extinctions over 0..1 without jumps. */
extern const tc_knot test_soft[4];
void test_scene_knots(tc_scene *scene, tc_knot_kind kind, const tc_knot *knots, size_t count);
/* size: fovY in degrees, or the height in mm. Chooses an up vector across the view. */
void test_scene_look(tc_scene *scene, tc_projection projection, const double from[3], const double to[3], double size);
/* Looks at the volume's centre from direction `side` (LPS), with the whole volume in view. */
void test_scene_frame(tc_scene *scene, const tc_volume *volume, tc_projection projection, const double side[3]);

#endif
