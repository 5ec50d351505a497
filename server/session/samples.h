/* Limits on the work of a picture, in estimated samples (tc_estimate_samples()). Pure; any thread. */
#ifndef TCS_SESSION_SAMPLES_H
#define TCS_SESSION_SAMPLES_H

#include "renderer/tomocast.h"

typedef struct tcs_samples_limits {
  double picture, ray; /* largest number of samples of a picture, and of one of its rays */
} tcs_samples_limits;

/* Reduces the picture's size until the scene is within the limits. False: no size is. */
bool tcs_samples_shrink(const tc_volume *volume, tc_scene *scene, tc_mesh *const *meshes, const tcs_samples_limits *limits);
/* TC_ERROR_LIMIT with the estimate, the limit and the smallest change that passes. The scene was checked by the planner
 * before. */
bool tcs_samples_check(const tc_volume *volume, const tc_scene *scene, tc_mesh *const *meshes,
                       const tcs_samples_limits *limits, GError **error);

#endif
