/* From the field to grey for the projections (mip, minip, average): the scene's window, folded with the volume's
 * rescale into one line, the same numbers for every back end.
 *
 * The sign of voxels is chosen so that mip and minip are both a maximum: w = sign * voxel, with sign = -1 for minip, and the
 * other way round in a volume of negative slope. grey = clamp(gain * w + offset, 0, 1). No w below `floor` or above `stop`
 * makes another grey than these ends do: a maximum starts at floor, and a ray that has reached stop (which is at most
 * the largest w of the volume) is finished. */
#ifndef TC_RAYCAST_GREY_H
#define TC_RAYCAST_GREY_H

#include "renderer/scene.h"
#include "renderer/volume/volume.h"

typedef struct tc_grey {
  float sign; /* 1 or -1 */
  float gain, offset;
  float floor, stop; /* of w; floor < stop unless all of the volume lies on one side of the window */
} tc_grey;

/* A maximum lies between samples as a rule: after the march a ray of mip or minip looks half a step and a quarter of
 * one to both sides of its greatest sample, or of what it has found by then. Values of the field all of them, so that no
 * ray shows what is not there. A ray has found either end of grey, or its samples show no more than floor: no look. */
enum { TC_PEAK_ROUNDS = 2 };

/* True for the modes that project through the window. */
bool tc_is_projection(tc_mode mode);

/* The window was validated (tc_plan_make). Pure. */
tc_grey tc_grey_make(const tc_volume *volume, const tc_scene *scene);

#endif
