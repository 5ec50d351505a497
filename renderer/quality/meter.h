/* The error meter: estimates the error of a finished frame against the rendering integral from random pixels.
 *
 * Pixels are sampled one from each of `count` cells of equal area (stratified, seeded), and the reference integrates
 * them anew. The truth of a pixel of several rays is the mean of the integrals of the same rays (raycast/subpixel.h),
 * to which the frame converges as the step goes to 0: the meter measures the error of sampling along a ray, for any
 * number of rays. The difference between a few rays and the mean over the pixel's area (antialiasing) is another error,
 * which no step reduces; tomocast report measures it as areaRms, in addition to rms against the centre ray. The meter
 * compares colours before rounding to 8 bits and encoding: with the background behind them, in sRGB, 0..1, three
 * channels; over a transparent background premultiplied colour and opacity, four channels, in the compositing space. An
 * error of 1/255 is one step of an 8-bit picture. */
#ifndef TC_QUALITY_METER_H
#define TC_QUALITY_METER_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "renderer/quality/depths.h"
#include "renderer/tomocast.h"

typedef struct tc_meter tc_meter;

enum { TC_METER_SURFACES = 32 };

/* Estimates for the whole frame from the measured pixels. */
typedef struct tc_meter_result {
  double rms;       /* root of the mean squared difference over channels and pixels */
  double low, high; /* 95 % confidence interval of rms: Student's t on the mean of the pixels' squared differences,
                       taken in its logarithm (squares are skewed and never below 0); both 0 where every pixel is exact */
  double max;       /* largest difference of a channel among these pixels: a lower bound for the frame */
  int pixels;       /* number of measured pixels */
  /* If tc_meter_wants_depth(): depth of the first surface against the exact surface (the root of the trilinear field of
   * the
     volume or of a label's smoothed indicator; a mesh's own triangles). All surfaces together, then one by one. */
  tc_depth_error depth, surfaces[TC_METER_SURFACES];
  tc_depth_error layers[TC_FRAME_LAYERS]; /* of a frame with layers: those along the rays in order, the first surface, what is
                                             seen through it, and so on */
  int n_layers;   /* as many as a measured pixel has in picture or truth */
  int n_surfaces; /* surfaces hit; if more than TC_METER_SURFACES, those with the most pixels */
  double ms;      /* time of the measurement */
} tc_meter_result;

/* Picks the pixels and copies the frame's values there. `frame` was rendered with want_linear, and with want_depth if
 * tc_meter_wants_depth(); other modes' depths are not read. count >= number of pixels: every pixel once. The caller
 * frees. NULL: out of memory. Fast enough for the render thread. */
tc_meter *tc_meter_new(const tc_frame *frame, int count, uint64_t seed);
static inline bool tc_meter_wants_depth(const tc_scene *s) {
  return s->mode == TC_MODE_ISOSURFACE || s->mode == TC_MODE_MESH;
}
void tc_meter_free(tc_meter *meter); /* NULL is fine */

/* The inputs that a frame was rendered from; borrowed. */
typedef struct tc_meter_subject {
  tc_volume *volume;
  tc_volume *labels;             /* the volume that scene->labels.volume names; NULL if it names none */
  struct tc_mesh *const *meshes; /* as in tc_render_request */
  const tc_scene *scene;
  const atomic_bool *cancel; /* NULL: never */
} tc_meter_subject;

/* Measures the frame against the reference. Meshes of more than 256 MiB together are TC_ERROR_LIMIT. Any thread. After
 * most_ms (0 = no limit) the measurement ends with the pixels it has, which were taken in random order.
 * TC_ERROR_CANCELLED when *cancel is set; TC_ERROR_UNSUPPORTED if the scene has no reference. */
bool tc_meter_measure(const tc_meter *meter, const tc_meter_subject *of, double most_ms, tc_meter_result *result,
                      GError **error);

/* The reference of a scene, with the labels and meshes that its surfaces need. The caller frees it. NULL with *error
 * set. */
tc_reference *tc_meter_reference(const tc_meter_subject *of, int width, int height, GError **error);

/* The limit of a pixel as the step goes to 0; rgba in the form of tc_frame.linear. share: the pixel_share of
 * tc_render_request, 1 if none was given. */
void tc_meter_truth(const tc_reference *reference, const tc_scene *scene, int x, int y, double share, double rgba[4]);

/* Fills rms, low and high from n squared differences of pixels (mean over channels). */
void tc_meter_estimate(const double *squares, int n, tc_meter_result *result);

/* The squared difference of two pixels (in the form of tc_frame.linear) over the scene's background, mean over
 * channels; raises *max to the largest difference of a channel. */
double tc_meter_square(const tc_scene *scene, const double a[4], const double b[4], double *max);

#endif
