/* Distance of a drawn surface from the exact one, in outline and depth against the reference's roots, for meshes of
 * decreasing size, with their triangles and milliseconds. */
#ifndef TCS_BENCH_SURFACES_H
#define TCS_BENCH_SURFACES_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"

/* Simplifies the mesh of the scene's isosurface in levels: [{"errorMm", "triangles", "ms", "outline", "depthRmsMm",
 * "depthP50Mm", "depthP99Mm", "depthMaxMm"}] (renderer/quality/depths.h), the full mesh first; then the isosurface by
 * ray casting, without "triangles". Frames of scene->image are timed, pictures of side x side are compared. */
cJSON *tcs_surface_levels(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int runs, int side,
                          GError **error);

#endif
