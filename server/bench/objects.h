/* tomocast bench --objects: a volume's objects drawn as splats, as ray-cast isosurfaces and as meshes, beside what the
 * plan expects (plan/object_cost.h): how often it names the faster. */
#ifndef TCS_BENCH_OBJECTS_H
#define TCS_BENCH_OBJECTS_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"

typedef struct tcs_objects_run {
  int runs, threads; /* timed frames of each way; 0: one a core */
  bool print;
} tcs_objects_run;

/* Adds a volume's scenes, of three thresholds, zooms and sizes, to the report. */
bool tcs_objects_volume(const tcs_objects_run *run, tc_volume *volume, const char *name, cJSON *report, GError **error);
/* After the last: how many were named rightly. */
void tcs_objects_end(const tcs_objects_run *run, const cJSON *report);

#endif
