/* From composited light to the picture's bytes; both back ends call it, so both round alike. */
#include <math.h>
#include <pthread.h>

#include "renderer/backend.h"

/* Linear light -> sRGB by a table of 4096 steps with interpolation: within 0.1 of an 8-bit step everywhere but the toe, which
 * is the straight part of the curve and computed. */
#define SRGB_STEPS 4096
static float srgb_table[SRGB_STEPS + 2];
static pthread_once_t srgb_once = PTHREAD_ONCE_INIT;

static void fill_srgb(void) {
  for (int i = 0; i < SRGB_STEPS + 2; i++) srgb_table[i] = (float)tc_linear_to_srgb((double)i / SRGB_STEPS);
}

static float encode_srgb(float c) {
  if (c <= 0.0031308f) return c * 12.92f;
  float x = c * SRGB_STEPS;
  int i = (int)x;
  if (i >= SRGB_STEPS) return 1;
  return srgb_table[i] + (x - (float)i) * (srgb_table[i + 1] - srgb_table[i]);
}

void tc_resolve_init(tc_resolve *resolve, const tc_scene *scene) {
  pthread_once(&srgb_once, fill_srgb);
  resolve->transparent = scene->image.transparent;
  resolve->linear_light = scene->image.linear_light;
  for (int c = 0; c < 3; c++) {
    double b = scene->image.background[c];
    resolve->background[c] = (float)(scene->image.linear_light ? tc_srgb_to_linear(b) : b);
  }
}

static uint8_t to_byte(float c) {
  c = c < 0 ? 0 : c > 1 ? 1 : c;
  return (uint8_t)(c * 255 + 0.5f);
}

void tc_resolve_row(const tc_resolve *r, const float *linear, uint8_t *rgba, int count) {
  for (int i = 0; i < count; i++, linear += 4, rgba += 4) {
    float alpha = linear[3], c[3];
    if (r->transparent) {
      float scale = alpha > 0 ? 1 / alpha : 0; /* straight alpha, as PNG wants it */
      for (int k = 0; k < 3; k++) c[k] = linear[k] * scale;
    } else {
      for (int k = 0; k < 3; k++) c[k] = linear[k] + (1 - alpha) * r->background[k];
    }
    if (r->linear_light)
      for (int k = 0; k < 3; k++) c[k] = encode_srgb(c[k] < 1 ? c[k] : 1);
    for (int k = 0; k < 3; k++) rgba[k] = to_byte(c[k]);
    rgba[3] = r->transparent ? to_byte(alpha) : 255;
  }
}
