/* How large a dispatch may be, so that none is without a look at the halt for long: from what earlier ones took. Pure. */
#ifndef TC_GL_PACE_H
#define TC_GL_PACE_H

#include <stdbool.h>

#define TC_GL_GROUP 8 /* local_size_x and _y of head.glsl */
#define TC_GL_TILE_MS 15 /* what a dispatch is expected to take, at most */

typedef struct tc_gl_pace {
  bool hardware;
  int most;         /* pixels of a tile */
  double sample_ns; /* of a sample, as tc_estimate_samples() counts them, in a tile of many: the slowest lately */
  double ray_ns;    /* and in the ray that waits for it: what no smaller tile makes shorter */
} tc_gl_pace;

/* Before anything was measured: some GPU that is much slower than those known. */
void tc_gl_pace_init(tc_gl_pace *pace, bool hardware, int most);

/* How many pixels of so many samples make a tile; what a tile is expected to take, and the smallest. */
int tc_gl_pace_pixels(const tc_gl_pace *pace, double pixel_samples);
double tc_gl_pace_ms(const tc_gl_pace *pace, int pixels, double pixel_samples);
double tc_gl_pace_least_ms(const tc_gl_pace *pace, double pixel_samples);

/* A tile took so long. */
void tc_gl_pace_learn(tc_gl_pace *pace, int pixels, double pixel_samples, double ms);

#endif
