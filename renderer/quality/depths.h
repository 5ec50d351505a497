/* How far drawn surfaces are from the exact ones: outlines and depths, pixel by pixel. The one definition of both, for the
 * error meter, tomocast report and tests. */
#ifndef TC_QUALITY_DEPTHS_H
#define TC_QUALITY_DEPTHS_H

#include <stdint.h>

#include "renderer/scene/scene.h"

typedef struct tc_reference tc_reference;

/* One pixel: the nearest surface that its rays meet; mm from the eye along the ray, INFINITY: none. */
typedef struct tc_depths {
  double drawn; /* as tc_frame.depth has it */
  /* The exact one: of the nearest of the pixel's rays, and the mean of those that meet one. Mode mesh draws, of several
     samples, the depth in the middle of those that one triangle covers, which lies between these two: such a pixel is
     wrong by how far it is outside of them, the least that its error can be. Otherwise both are the nearest. */
  double nearest, mean;
  int surface;    /* of the scene's list: which the exact one is, 0 in a scene without a list */
  uint32_t label; /* of the labels that it is the surface of; 0: of none */
} tc_depths;

/* Everything but `drawn`; x, y: a pixel of the picture that the reference was made for. Any thread. */
void tc_depths_exact(const tc_reference *reference, const tc_scene *scene, int x, int y, tc_depths *pixel);

typedef struct tc_depth_error {
  int surface;    /* as in tc_depths; of all surfaces together 0 */
  uint32_t label;
  int both, one;  /* pixels where picture and reference have a surface, and where only one of them has: wrong outlines;
                     those that only the picture has are of no surface, and count in all of them together */
  double outline; /* one, as a share of all pixels */
  double rms, p50, p99, max; /* mm, of `both`: half of them, 99 of 100, all of them are at most so far off; 0 for none */
} tc_depth_error;

/* Sorts the pixels. all: of all surfaces; each[most]: of every one that is met, that of most pixels first. Gives back how
 * many there are, at most `most`. */
int tc_depths_compare(tc_depths *pixels, int n, tc_depth_error *all, tc_depth_error *each, int most);

#endif
