/* Projections (mip, minip, average): mapping of the field to grey. The scene's window and the volume's slope and
 * intercept are combined into one linear map, with the same numbers for every back end.
 *
 * Voxels are negated for minip, so that mip and minip are both a maximum: w = sign * voxel, with sign = -1 for minip
 * (in a volume of negative slope for mip). grey = clamp(gain * w + offset, 0, 1). Any w below `floor` has the grey of
 * floor, and any w above `stop` that of stop. A maximum therefore starts at floor, and a ray that has reached stop (at
 * most the largest w of the volume) is finished. */
#ifndef TC_RAYCAST_PROJECTION_H
#define TC_RAYCAST_PROJECTION_H

#include "renderer/scene/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_grey {
  float sign; /* 1 or -1 */
  float gain, offset;
  float floor, stop; /* of w; floor < stop unless all of the volume lies on one side of the window */
} tc_grey;

/* Rounds of peak refinement. The maximum usually lies between samples, so after the march a ray of mip or minip samples
 * half a step, then a quarter, to both sides of its maximum. All candidates are values of the field, so the result
 * never exceeds the field's maximum. Rays that ended at floor or stop are not refined, because their grey cannot
 * change. */
enum { TC_PEAK_ROUNDS = 2 };

bool tc_is_projection(tc_mode mode);

/* The window was validated (tc_plan_check). Pure. */
tc_grey tc_grey_make(const tc_volume *volume, const tc_scene *scene);

#endif
