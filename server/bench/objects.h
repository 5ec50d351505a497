/* tomocast bench --objects: objects of a volume drawn as splats, ray-cast isosurfaces and meshes, with the plan's
 * estimates (plan/object_cost.h), and how often the plan names the fastest. */
#ifndef TCS_BENCH_OBJECTS_H
#define TCS_BENCH_OBJECTS_H

#include <cjson/cJSON.h>

#include "renderer/plan/object_cost.h"
#include "renderer/tomocast.h"
#include "server/bench/difference.h"

/* An opaque object above a threshold, drawn in each mode that can draw it. */
typedef struct tcs_object {
  double ms[TC_OBJECT_MODES];          /* shortest frame */
  double samples[TC_OBJECT_MODES];     /* of a frame: splats put down, samples of rays, triangles */
  double build_ms[TC_OBJECT_MODES];    /* of what the first frame builds and later ones find */
  tc_object_cost cost;                 /* the plan's estimate */
  tcs_difference off[TC_OBJECT_MODES]; /* difference from the exact surface; no pixels: not compared */
} tcs_object;

/* A lit scene in mode splat of the object whose threshold lies this share of the way from the fitted surface to the
 * largest values. Caller calls tc_scene_clear(). */
void tcs_object_scene(const tc_volume *volume, double share, int size, tc_scene *scene);
/* Renders `runs` frames of scene->image in each mode, in turn, after one that builds the resources. */
bool tcs_object_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int runs, tcs_object *object,
                        GError **error);
/* Compares pictures of side x side pixels with the reference integrator's isosurface. */
bool tcs_object_judge(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, int side, tcs_object *object,
                      GError **error);
/* {"threshold", "size", "ms", "samples", "buildMs", "expectedMs", "errors": {mode: ...}, "terms", "named", "namedOfThree"}. */
cJSON *tcs_object_json(const tcs_object *object, const tc_scene *scene);

typedef struct tcs_objects_run {
  int runs, threads; /* timed frames per mode; threads: 0 = one per core */
  bool print;
  const char *isa; /* NULL: the fastest */
} tcs_objects_run;

/* Adds a volume's scenes (several thresholds, zooms and sizes) to the report. */
bool tcs_objects_volume(const tcs_objects_run *run, tc_volume *volume, const char *name, cJSON *report, GError **error);
/* After the last volume: prints how often the plan named the fastest. */
void tcs_objects_end(const tcs_objects_run *run, const cJSON *report);

#endif
