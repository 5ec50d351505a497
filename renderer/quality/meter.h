/* The error meter: how far a finished frame is from the rendering integral, by random pixels of it.
 *
 * Pixels are drawn one from each of `count` cells of equal area (stratified), seeded, and integrated anew by the
 * reference. The truth of a pixel of several rays is the mean of the integrals of those very rays (raycast/subpixel.h),
 * to which the frame converges as the step goes to 0: the error is that of sampling a ray, for any number of them. How
 * far a few rays are from the mean over the pixel's area (smooth edges) is another error, which no step reduces; tomocast
 * report measures it as areaRms, beside rms against the ray of the centre. The meter compares the colour that the frame
 * shows before rounding to 8 bits and encoding: with the background behind it, in sRGB, 0..1, three
 * channels; over a transparent background the premultiplied colour and the opacity, four channels, in the compositing
 * space. Errors are in units of 1.0: 1/255 is one step of a picture. */
#ifndef TC_QUALITY_METER_H
#define TC_QUALITY_METER_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>

#include "renderer/quality/depths.h"
#include "renderer/tomocast.h"

typedef struct tc_meter tc_meter;

enum { TC_METER_SURFACES = 32 };

/* Estimates for the whole frame from the pixels that were measured. */
typedef struct tc_meter_result {
  double rms;       /* root of the mean squared difference over channels and pixels */
  double low, high; /* 95 % confidence interval of rms: Student's t on the mean of the pixels' squared differences,
                       taken in its logarithm (squares are skewed and never below 0); both 0 where every pixel is exact */
  double max;       /* largest difference of a channel among these pixels: the frame's own is at least this */
  int pixels;       /* measured */
  /* Where tc_meter_wants_depth(): the nearest surface that a pixel's rays meet, against the exact one: the root of the
     trilinear field, be it the volume's or a label's smoothed one, and a mesh's own triangles. All surfaces together, then one by one. */
  tc_depth_error depth, surfaces[TC_METER_SURFACES];
  int n_surfaces; /* that were met; those of most pixels where they are more than there is room for */
  double ms;      /* what it took */
} tc_meter_result;

/* Picks the pixels and keeps what the frame has there; `frame` was rendered with want_linear, and with want_depth where
 * tc_meter_wants_depth(); depths that it has in other modes are not read. All pixels, once each,
 * when `count` is at least as many. NULL when memory is short. Quick: for the render thread. */
tc_meter *tc_meter_new(const tc_frame *frame, int count, uint64_t seed);
static inline bool tc_meter_wants_depth(const tc_scene *s) {
  return s->mode == TC_MODE_ISOSURFACE || s->mode == TC_MODE_MESH;
}
void tc_meter_free(tc_meter *meter); /* NULL is fine */

/* What a frame was rendered from. */
typedef struct tc_meter_subject {
  tc_volume *volume;
  tc_volume *labels;             /* the volume that scene->labels.volume names; NULL where it names none */
  struct tc_mesh *const *meshes; /* as in tc_render_request */
  const tc_scene *scene;
  const atomic_bool *cancel; /* NULL: never */
} tc_meter_subject;

/* Measures the frame against its truth. Meshes of more than 256 MiB together are TC_ERROR_LIMIT. Any thread. After most_ms (0 = no limit) it stops with the pixels it has: they
 * are taken in random order. TC_ERROR_CANCELLED when *cancel is set; TC_ERROR_UNSUPPORTED where the scene has no
 * reference. */
bool tc_meter_measure(const tc_meter *meter, const tc_meter_subject *of, double most_ms, tc_meter_result *result,
                      GError **error);

/* The reference of any scene, with the labels and meshes that its surfaces need. */
tc_reference *tc_meter_reference(const tc_meter_subject *of, int width, int height, GError **error);

/* What a pixel of the frame goes to as the step goes to 0; rgba as tc_frame.linear has it. share: tc_render_request's
 * pixel_share, 1 where none was given. */
void tc_meter_truth(const tc_reference *reference, const tc_scene *scene, int x, int y, double share, double rgba[4]);

/* The estimate from n squared differences of pixels (mean over channels). */
void tc_meter_estimate(const double *squares, int n, tc_meter_result *result);

/* The difference of two pixels (as tc_frame.linear has them) under a scene's background: mean square over channels;
 * *max grows to the largest. */
double tc_meter_square(const tc_scene *scene, const double a[4], const double b[4], double *max);

#endif
