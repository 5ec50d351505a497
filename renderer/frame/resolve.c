/* From composited light to the picture's bytes; shared by both back ends, so that they round alike. */
#include <emmintrin.h>
#include <math.h>
#include <pthread.h>

#include "renderer/frame/backend.h"
#include "renderer/classify/transfer.h"

/* Linear light -> sRGB by an interpolated table of 4096 steps: within 0.1 of an 8-bit step. The linear toe of the curve
 * is computed instead. */
#define SRGB_STEPS TC_LIGHT_STEPS
static float srgb_table[SRGB_STEPS + 2], light_table[SRGB_STEPS + 2]; /* linear light -> sRGB, and back */
static pthread_once_t srgb_once = PTHREAD_ONCE_INIT;

static void fill_srgb(void) {
  for (int i = 0; i < SRGB_STEPS + 2; i++) {
    srgb_table[i] = (float)tc_linear_to_srgb((double)i / SRGB_STEPS);
    light_table[i] = (float)tc_srgb_to_linear((double)i / SRGB_STEPS);
  }
}

static float encode_srgb(float c) {
  if (c <= 0.0031308f) return c * 12.92f;
  float x = c * SRGB_STEPS;
  int i = (int)x;
  if (i >= SRGB_STEPS) return 1;
  return srgb_table[i] + (x - (float)i) * (srgb_table[i + 1] - srgb_table[i]);
}

/* The greys of a slice are display values and are not converted. */
bool tc_resolve_is_linear(const tc_scene *scene) { return scene->image.linear_light && scene->mode != TC_MODE_MPR; }

void tc_resolve_init(tc_resolve *resolve, const tc_scene *scene) {
  pthread_once(&srgb_once, fill_srgb);
  resolve->transparent = scene->image.transparent;
  resolve->linear_light = tc_resolve_is_linear(scene);
  for (int c = 0; c < 3; c++) {
    double b = scene->image.background[c];
    resolve->background[c] = (float)(resolve->linear_light ? tc_srgb_to_linear(b) : b);
  }
}

/* A very narrow window must not give an infinite gain: infinity times zero is NaN. */
static float bounded(double x) { return (float)fmin(fmax(x, -1e30), 1e30); }

void tc_slice_window_init(tc_slice_window *grey, const tc_volume *volume, const tc_scene *scene) {
  const tc_volume_desc *d = tc_volume_describe(volume);
  const tc_volume_stats *s = tc_volume_statistics(volume);
  double lo = d->slope > 0 ? s->voxel_min : s->voxel_max, sign = d->slope > 0 ? 1 : -1;
  grey->lo = (float)lo;
  grey->sign = (float)sign;
  grey->last = (float)(s->voxel_max - s->voxel_min);
  grey->center = bounded(((scene->window.center - d->intercept) / d->slope - lo) * sign);
  grey->gain = bounded(fabs(d->slope) / scene->window.width);
}

static uint8_t to_byte(float c) {
  c = c < 0 ? 0 : c > 1 ? 1 : c;
  return (uint8_t)(c * 255 + 0.5f);
}

static inline __m128i pixel_over(const float *linear, __m128 behind) {
  const __m128 one = _mm_set1_ps(1);
  __m128 c = _mm_loadu_ps(linear), clear = _mm_sub_ps(one, _mm_shuffle_ps(c, c, 0xff));
  c = _mm_add_ps(c, _mm_mul_ps(clear, behind));
  c = _mm_min_ps(_mm_max_ps(c, _mm_setzero_ps()), one);
  return _mm_cvttps_epi32(_mm_add_ps(_mm_mul_ps(c, _mm_set1_ps(255)), _mm_set1_ps(0.5f)));
}

/* The common case, display space over an opaque background: four pixels at a time, with the arithmetic of the scalar
 * loop. Returns the number of pixels done. */
static int resolve_opaque(const tc_resolve *r, const float *linear, uint8_t *rgba, int count) {
  const __m128 behind = _mm_setr_ps(r->background[0], r->background[1], r->background[2], 1); /* opacity ends as 1 */
  int i = 0;
  for (; i + 4 <= count; i += 4) {
    const float *p = linear + 4 * i;
    const __m128i first = _mm_packs_epi32(pixel_over(p, behind), pixel_over(p + 4, behind));
    const __m128i last = _mm_packs_epi32(pixel_over(p + 8, behind), pixel_over(p + 12, behind));
    __m128i bytes = _mm_packus_epi16(first, last);
    bytes = _mm_or_si128(bytes, _mm_set1_epi32((int)0xff000000u));
    _mm_storeu_si128((__m128i *)(void *)(rgba + 4 * i), bytes);
  }
  return i;
}

void tc_resolve_row(const tc_resolve *r, const float *linear, uint8_t *rgba, int count) {
  int done = r->transparent || r->linear_light ? 0 : resolve_opaque(r, linear, rgba, count);
  linear += 4 * done, rgba += 4 * done;
  for (int i = done; i < count; i++, linear += 4, rgba += 4) {
    float alpha = linear[3], c[3];
    if (r->transparent) {
      float scale = alpha > 0 ? 1 / alpha : 0; /* straight alpha, as in PNG */
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

const float *tc_resolve_light(void) {
  pthread_once(&srgb_once, fill_srgb);
  return light_table;
}
