/* Tile sizes: the largest dispatch, predicted from the times of earlier ones, that still lets the halt be polled often
 * enough. Pure. */
#ifndef TC_GL_PACE_H
#define TC_GL_PACE_H

#include <stdbool.h>

#define TC_GL_GROUP 8 /* local_size_x and _y of head.glsl */
#define TC_GL_TILE_MS 15 /* longest expected time of a dispatch */

typedef struct tc_gl_pace {
  bool hardware;
  int most;         /* most pixels per tile */
  double sample_ns; /* throughput: time per sample (of tc_estimate_samples()) in a large tile; decaying maximum */
  double ray_ns;    /* latency: time per sample along one ray, which smaller tiles do not reduce */
} tc_gl_pace;

/* Initial values: assumes a GPU much slower than known ones. */
void tc_gl_pace_init(tc_gl_pace *pace, bool hardware, int most);

/* For pixels of pixel_samples samples each: pixels per tile; expected time of a tile; expected time of the smallest
 * tile. */
int tc_gl_pace_pixels(const tc_gl_pace *pace, double pixel_samples);
double tc_gl_pace_ms(const tc_gl_pace *pace, int pixels, double pixel_samples);
double tc_gl_pace_least_ms(const tc_gl_pace *pace, double pixel_samples);

/* Learns from the time of a tile. */
void tc_gl_pace_learn(tc_gl_pace *pace, int pixels, double pixel_samples, double ms);

#endif
