/* Where a frame's time goes: differences between frames of the same rays, each of which does one thing more. */
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
  double ms[TCS_STAGES]; /* tables, skipping and encoding are the caller's */
  double samples;        /* of the frames, without leaping and early termination */
} tcs_stages;

/* Frames of a scene of mode dvr in turns, each at its least: that show nothing (leapt over, then sampled by the nearest
 * voxel, then linearly), unlit, and lit. Traversal so holds the load of one voxel, fetch the rest of a sample. */
bool tcs_stages_measure(tc_renderer *renderer, tc_volume *volume, const tc_scene *scene, tcs_stages *stages,
                        GError **error);
/* cycles: of all threads a millisecond. */
void tcs_stages_print(const tcs_stages *stages, double cycles);
cJSON *tcs_stages_as_json(const tcs_stages *stages);

#endif
