/* Time per stage of a frame: differences between frames of the same rays, each with one more stage. */
#ifndef TC_SERVER_STAGES_H
#define TC_SERVER_STAGES_H

#include <cjson/cJSON.h>

#include "renderer/tomocast.h"

typedef enum tcs_stage {
  TCS_STAGE_RESOLVE,
  TCS_STAGE_TRAVERSAL,
  TCS_STAGE_FETCH,
  TCS_STAGE_CLASSIFY,
  TCS_STAGE_SHADE,
  TCS_STAGE_TABLES,
  TCS_STAGE_SKIP,
  TCS_STAGE_ENCODE,
  TCS_STAGES
} tcs_stage;

typedef struct tcs_stages {
  double ms[TCS_STAGES]; /* tables, skipping and encoding are filled in by the caller */
  double samples;        /* of the frames, without empty-space skipping and early termination */
} tcs_stages;

/* Measures frames of a scene in mode dvr, in turn, the shortest of each: invisible (skipped; then sampled with the
 * nearest filter; then with the linear filter), unlit, and lit. So traversal includes the load of one voxel, and fetch
 * that of the rest of a sample. */
bool tcs_stages_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, tcs_stages *stages,
                        GError **error);
/* cycles: of all threads, per millisecond. */
void tcs_stages_print(const tcs_stages *stages, double cycles);
cJSON *tcs_stages_as_json(const tcs_stages *stages);

#endif
