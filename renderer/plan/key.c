#include "renderer/plan/key.h"

#include <stdio.h>

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

void tc_plan_key_name(const tc_plan_key *key, char *name, size_t size) {
  bool dvr = key->mode == TC_MODE_DVR, slice = key->mode == TC_MODE_MPR;
  const char *way = !slice && !dvr ? "" : dvr ? tc_classification_names[key->classification]
                                   : key->slab ? tc_slab_projection_names[key->slab - 1] : "slice";
  if (key->mode == TC_MODE_SPLAT) {
    snprintf(name, size, "splat%s.%s", key->shading ? ".shaded" : "", tc_voxel_type_name((tc_voxel_type)key->voxel_type));
    return;
  }
  snprintf(name, size, "%s%s%s%s.%s%s%s%s%s.%s", tc_mode_names[key->mode], *way ? "." : "", way,
           key->order == TC_BACK_TO_FRONT ? ".back-to-front" : "", tc_filter_names[key->filter],
           key->shading ? ".shaded" : "", key->labels == TC_PLAN_GAPS ? ".gaps" : key->labels ? ".labels" : "", key->rays ? ".rays" : "",
           key->jitter ? ".jitter" : "", tc_voxel_type_name((tc_voxel_type)key->voxel_type));
}

tc_plan_key tc_plan_unskipped(tc_plan_key key) {
  key.skipping = key.coherence = 0;
  return key;
}
