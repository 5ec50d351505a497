/* tomocast bench --objects: a volume's objects drawn as splats, as ray-cast isosurfaces and as meshes, beside what the
 * plan expects (plan/object_cost.h): how often it names the faster. */
#ifndef TCS_BENCH_OBJECTS_H
#define TCS_BENCH_OBJECTS_H

#include <cjson/cJSON.h>

#include "renderer/plan/object_cost.h"
#include "renderer/tomocast.h"
#include "server/bench/difference.h"

/* An opaque object of a threshold, drawn in each mode that can. */
typedef struct tcs_object {
  double ms[TC_OBJECT_MODES];          /* the least of its frames */
  tc_object_cost cost;                 /* what the plan expects */
  tcs_difference off[TC_OBJECT_MODES]; /* from the exact surface of the threshold; no pixels: not compared */
} tcs_object;

/* The object of a threshold that lies this share of the way from the fitted surface to the largest values, lit, in mode
 * splat. tc_scene_clear() it. */
void tcs_object_scene(const tc_volume *volume, double share, int size, tc_scene *scene);
/* Frames of scene->image, `runs` of each mode in turn, after one that builds. */
bool tcs_object_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int runs, tcs_object *object,
                        GError **error);
/* Compares pictures of side x side pixels with the reference integrator's isosurface. */
bool tcs_object_judge(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int side, tcs_object *object,
                      GError **error);
/* {"threshold", "size", "ms", "expectedMs", "errors": {mode: ...}, "terms", "named", "namedOfThree"}. */
cJSON *tcs_object_json(const tcs_object *object, const tc_scene *scene);

typedef struct tcs_objects_run {
  int runs, threads; /* timed frames of each way; 0: one a core */
  bool print;
  const char *isa; /* NULL: the fastest */
} tcs_objects_run;

/* Adds a volume's scenes, of three thresholds, zooms and sizes, to the report. */
bool tcs_objects_volume(const tcs_objects_run *run, tc_volume *volume, const char *name, cJSON *report, GError **error);
/* After the last: how many were named rightly. */
void tcs_objects_end(const tcs_objects_run *run, const cJSON *report);

#endif
