/* How much work a picture may ask for: estimated samples (tc_estimate_samples()) against limits. Pure; any thread. */
#ifndef TCS_SESSION_SAMPLES_H
#define TCS_SESSION_SAMPLES_H

#include "renderer/tomocast.h"

typedef struct tcs_samples_limits {
  double picture, ray; /* most samples of a picture, and of one of its rays */
} tcs_samples_limits;

/* Makes the picture smaller until it passes. */
bool tcs_samples_shrink(const tc_volume *volume, tc_scene *scene, tc_mesh *const *meshes, const tcs_samples_limits *limits);
/* TC_ERROR_LIMIT with the number, the limit and the least change that passes. The scene was planned before. */
bool tcs_samples_check(const tc_volume *volume, const tc_scene *scene, tc_mesh *const *meshes,
                       const tcs_samples_limits *limits, GError **error);

#endif
