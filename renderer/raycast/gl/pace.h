/* Tile sizes: how large a dispatch may be, judged by the time of earlier ones, so that the halt is polled often
 * enough. Pure. */
#ifndef TC_GL_PACE_H
#define TC_GL_PACE_H

#include <stdbool.h>

#define TC_GL_GROUP 8 /* local_size_x and _y of head.glsl */
#define TC_GL_TILE_MS 15 /* longest expected time of a dispatch */

typedef struct tc_gl_pace {
  bool hardware;
  int most;         /* most pixels per tile */
  double sample_ns; /* throughput: time per sample (as tc_estimate_samples() counts them) in a large tile; the slowest lately */
  double ray_ns;    /* latency: time per sample along one ray, which no smaller tile reduces */
} tc_gl_pace;

/* Before any measurement: assumes a GPU much slower than known ones. */
void tc_gl_pace_init(tc_gl_pace *pace, bool hardware, int most);

/* Pixels per tile for pixels of so many samples; expected time of a tile of so many pixels; expected time of the
 * smallest tile. */
int tc_gl_pace_pixels(const tc_gl_pace *pace, double pixel_samples);
double tc_gl_pace_ms(const tc_gl_pace *pace, int pixels, double pixel_samples);
double tc_gl_pace_least_ms(const tc_gl_pace *pace, double pixel_samples);

/* Learns from the time of a tile. */
void tc_gl_pace_learn(tc_gl_pace *pace, int pixels, double pixel_samples, double ms);

#endif
