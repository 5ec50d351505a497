/* Error of drawn surfaces against exact ones, pixel by pixel: wrong outlines and errors in depth. The one definition of
 * both, for the error meter, tomocast report and tests. */
#ifndef TC_QUALITY_DEPTHS_H
#define TC_QUALITY_DEPTHS_H

#include <stdint.h>

#include "renderer/tomocast.h"

typedef struct tc_reference tc_reference;

/* Depths of one pixel: mm from the eye along the ray to the first surface; INFINITY: no surface. */
typedef struct tc_depths {
  double drawn; /* from tc_frame.depth */
  double nearest; /* exact: the smallest over the pixel's rays, as it is drawn */
  int surface;    /* index of the exact surface in the scene's list; 0 without a list */
  uint32_t label; /* label of the exact surface; 0: not a label's */
} tc_depths;

/* Fills all members but `drawn`; x, y: a pixel of the picture that the reference was made for. Any thread. */
void tc_depths_exact(const tc_reference *reference, const tc_scene *scene, int x, int y, tc_depths *pixel);

/* The same of the surfaces along the ray of a pixel with one ray, front to back: `nearest` of each (INFINITY: there are fewer);
 * surface and label are 0. */
void tc_depths_exact_layers(const tc_reference *reference, int x, int y, tc_depths layers[TC_FRAME_LAYERS]);

typedef struct tc_depth_error {
  int surface;    /* as in tc_depths; 0 for all surfaces together */
  uint32_t label;
  int both, one;  /* pixels where both picture and reference have a surface, and where only one of them has (a wrong
                     outline). Pixels where only the picture has one count in the total of all surfaces alone */
  double outline; /* `one` as a share of all pixels */
  double rms, p50, p99, max; /* errors in mm over the pixels `both`: root mean square, median, 99th percentile, largest;
                                0 if there are none */
} tc_depth_error;

/* Compares n pixels, and sorts them. *all: all surfaces together; each[most]: every surface of the reference, by
 * descending number of pixels. Returns the number of surfaces in `each`, at most `most`. */
int tc_depths_compare(tc_depths *pixels, int n, tc_depth_error *all, tc_depth_error *each, int most);

#endif
