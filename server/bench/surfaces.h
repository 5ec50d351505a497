/* How far a drawn surface is from the exact one: its outline and its depth against the reference's roots, and what that
 * costs in triangles and milliseconds. */
#ifndef TCS_BENCH_SURFACES_H
#define TCS_BENCH_SURFACES_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"

/* The mesh of the scene's isosurface, simplified ever further: [{"errorMm", "triangles", "ms", "outline",
 * "depthRmsMm", "depthP50Mm", "depthP99Mm", "depthMaxMm"}] (renderer/quality/depths.h), the full one first; then the isosurface by ray
 * casting, without "triangles". Frames of scene->image are timed, pictures of side x side compared. */
cJSON *tcs_surface_levels(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int runs, int side,
                          GError **error);

#endif
