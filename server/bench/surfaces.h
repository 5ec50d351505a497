/* How far a drawn surface is from the exact one: its outline and its depth against the reference's roots, and what that
 * costs in triangles and milliseconds. */
#ifndef TCS_BENCH_SURFACES_H
#define TCS_BENCH_SURFACES_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"

typedef struct tcs_surface_error {
  int pixels;     /* whose middle meets the exact surface */
  int missed;     /* of them, or beside them, where one of the two has a surface and the other none */
  double outline; /* missed pixels for one of the outline: how many pixels it is off, on average */
  /* mm along the ray, where both have one; a ray that slips past an edge goes far, so that the median says more than
   * the rms */
  double depth_rms, depth_p50, depth_p99, depth_max;
} tcs_surface_error;

/* The depths [side][side] of the exact isosurface of a scene, INFINITY where there is none; g_free() them. Every ray
 * goes through a pixel's middle. */
float *tcs_surface_truth(tc_volume *volume, const tc_scene *scene, int side, int threads, GError **error);
void tcs_surface_compare(const float *depth, const float *truth, int side, tcs_surface_error *out);

/* The mesh of the scene's isosurface, simplified ever further: [{"errorMm", "triangles", "ms", "outlinePixels",
 * "missed", "depthRmsMm", "depthP50Mm", "depthP99Mm", "depthMaxMm"}], the full one first; then the isosurface by ray
 * casting, without "triangles". Frames of scene->image are timed, pictures of side x side compared. */
cJSON *tcs_surface_levels(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int runs, int side,
                          GError **error);

#endif
