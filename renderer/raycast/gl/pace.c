#include "renderer/raycast/gl/pace.h"

#include <math.h>

/* Smallest credible times. The samples are an upper bound, so empty tiles seem fast; later tiles may be slower. */
#define SOFTWARE_NS 12.0
#define HARDWARE_NS 0.1
#define HARDWARE_RAY_NS 1500.0
#define CAREFUL 4         /* initial times are this many times slower */
#define KEPT (15.0 / 16)  /* decay of the slowest time, per faster tile */
#define OVERHEAD_MS 1.0   /* shorter times say nothing about samples */
#define LEAST_HARDWARE 4096 /* pixels that a GPU draws at once: fewer take as long */

static double least_sample_ns(const tc_gl_pace *p) { return p->hardware ? HARDWARE_NS : SOFTWARE_NS; }

/* In software, the pixels of a group are drawn one after another. */
static double least_ray_ns(const tc_gl_pace *p) {
  return p->hardware ? HARDWARE_RAY_NS : SOFTWARE_NS * TC_GL_GROUP * TC_GL_GROUP;
}

static int least_pixels(const tc_gl_pace *p) { return p->hardware ? LEAST_HARDWARE : TC_GL_GROUP * TC_GL_GROUP; }

void tc_gl_pace_init(tc_gl_pace *pace, bool hardware, int most) {
  *pace = (tc_gl_pace){.hardware = hardware, .most = most};
  pace->sample_ns = CAREFUL * least_sample_ns(pace);
  pace->ray_ns = least_ray_ns(pace);
}

double tc_gl_pace_ms(const tc_gl_pace *p, int pixels, double pixel_samples) {
  return fmax(pixels * p->sample_ns, p->hardware ? p->ray_ns : 0) * pixel_samples * 1e-6;
}

double tc_gl_pace_least_ms(const tc_gl_pace *p, double pixel_samples) { return p->ray_ns * pixel_samples * 1e-6; }

int tc_gl_pace_pixels(const tc_gl_pace *p, double pixel_samples) {
  const double wanted = TC_GL_TILE_MS * 1e6 / (p->sample_ns * fmax(pixel_samples, 1));
  return (int)fmin(fmax(wanted, least_pixels(p)), p->most);
}

void tc_gl_pace_learn(tc_gl_pace *p, int pixels, double pixel_samples, double ms) {
  const double ray_ns = ms * 1e6 / fmax(pixel_samples, 1), ns = ms > OVERHEAD_MS ? ray_ns / pixels : 0;
  const bool smallest = pixels <= least_pixels(p) && ms > TC_GL_TILE_MS;
  if (!smallest || !p->hardware) p->sample_ns = fmax(fmax(ns, KEPT * p->sample_ns), least_sample_ns(p));
  /* At most doubled, so that a single delayed tile does not rule out all long rays. */
  p->ray_ns = fmax(fmax(smallest ? fmin(ray_ns, 2 * p->ray_ns) : 0, KEPT * p->ray_ns), least_ray_ns(p));
}
