/* Rays of the reference integrator, for its own tests. */
#ifndef TC_TESTS_REFERENCE_H
#define TC_TESTS_REFERENCE_H

#include <math.h>

#include "renderer/reference/reference.h"
#include "tests/support/grid.h"
#include "tests/support/test.h"

static inline double bad(double got, double want) { return fabs(got - want); }

static inline void report(const char *what, double error, double bound) {
  printf("  %-66s error %.2e (bound %.0e)\n", what, error, bound);
  if (!(error <= bound)) fail_msg("%s: error %g over %g", what, error, bound);
}

/* The ray from `from` towards `to` as a 1x1 picture. */
static inline void one_ray(tc_volume *volume, tc_scene *scene, const double from[3], const double to[3], double tolerance,
                    double rgba[4]) {
  GError *error = NULL;
  test_scene_look(scene, TC_ORTHOGRAPHIC, from, to, 1);
  g_autoptr(tc_reference) reference = tc_reference_new(volume, scene, 1, 1, tolerance, &error);
  if (!reference) fail_msg("%s", error->message);
  tc_reference_pixel(reference, 0.5, 0.5, rgba);
}

static inline tc_scene knots_scene(tc_knot_kind kind, const tc_knot *knots, size_t count) {
  tc_scene scene;
  test_scene(&scene, 1, 1);
  test_scene_knots(&scene, kind, knots, count);
  return scene;
}

static const double sheared[9] = {0.8, -0.6, 0, 0.6, 0.8, -0.25881904510252074, 0, 0, 0.9659258262890683};

#endif
