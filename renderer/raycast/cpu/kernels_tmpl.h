/* The ray caster, once, over the vector vocabulary: included by kernels_*.c after a simd_*.h. Each piece is a header of
 * its own; here they become kernels, one per variant that plans may name. */
#include "renderer/raycast/cpu/packet_tmpl.h"

#include "renderer/raycast/cpu/field_tmpl.h"

#include "renderer/raycast/cpu/cubic_tmpl.h"

#include "renderer/raycast/cpu/filter_tmpl.h"

#include "renderer/raycast/cpu/classify_tmpl.h"

#include "renderer/raycast/cpu/integrals_tmpl.h"

#include "renderer/raycast/cpu/zoom_tmpl.h"

#include "renderer/raycast/cpu/stiff_tmpl.h"

#include "renderer/raycast/cpu/subpixel_tmpl.h"

#include "renderer/raycast/cpu/segment_tmpl.h"

#include "renderer/raycast/cpu/shade_tmpl.h"

#include "renderer/raycast/cpu/gradient_tmpl.h"

#include "renderer/raycast/cpu/labels_tmpl.h"

#include "renderer/raycast/cpu/cover_tmpl.h"

#include "renderer/raycast/cpu/dvr_tmpl.h"

#include "renderer/raycast/cpu/back_tmpl.h"

#include "renderer/raycast/cpu/projection_tmpl.h"

#include "renderer/raycast/cpu/mpr_tmpl.h"

/* One ray a pixel. */
V_INLINE vf4 cast_rays(const tc_cpu_args *g, variant v, const place *at, skip_mood *mood, tc_cpu_counts *counts) {
  vf4 c;
  if (v.mode == TC_MODE_DVR && v.back_to_front)
    cast_back_to_front(g, v, at, &c, counts);
  else if (v.mode == TC_MODE_DVR)
    cast_packet(g, v, at, &c, counts);
  else if (v.mode == TC_MODE_AVERAGE)
    cast_average(g, v, at, &c, counts);
  else if (v.mode == TC_MODE_MPR)
    cast_slice(g, v, at, &c, counts);
  else
    cast_extreme(g, v, at, mood, &c, counts);
  return c;
}

/* The mean of all rays of each pixel. Colour stays under opacity, and that under 1: sums are rounded alike. Left between
 * two rays: the sum so far. */
V_INLINE vf4 cast_pixels(const tc_cpu_args *g, variant v, const place *first, skip_mood *mood, const float *out,
                         ptrdiff_t stride, tc_cpu_counts *counts) {
  place at = *first;
  vf4 sum = {v_set(0), v_set(0), v_set(0), v_set(0)};
  if (v.several && counts->ray) sum = load_packet(first, out, stride);
  at.ray += counts->ray;
  for (int r = counts->ray; r == 0 || r < g->count; r++, at.ray++) {
    vf4 c = cast_rays(g, v, &at, mood, counts);
    if (!v.several) return c;
    if (counts->left) {
      counts->ray = r;
      return sum;
    }
    sum = (vf4){sum.r + c.r, sum.g + c.g, sum.b + c.b, sum.a + c.a};
  }
  counts->ray = 0;
  vf n = v_set((float)g->count);
  return (vf4){sum.r / n, sum.g / n, sum.b / n, sum.a / n};
}

V_INLINE void cast_tile(const tc_cpu_args *g, variant v, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,
                        tc_cpu_counts *counts) {
  skip_mood mood = {0};
  int packet = 0;
  for (int y = y0; y < y1; y += V_PACKET_Y)
    for (int x = x0; x < x1; x += V_PACKET_X, packet++) {
      if (packet < counts->packet) continue;
      place at = {x, y, x1, y1, g->of_pixel};
      float *to = out + ((y - y0) * stride + (x - x0)) * 4;
      vf4 c = cast_pixels(g, v, &at, &mood, to, stride, counts);
      store_packet(c, &at, to, stride);
      counts->packet = packet + !counts->left;
      if (counts->left) return;
    }
}

#define KERNEL(name, ...)                                                                                            \
  static void name(const tc_cpu_args *g, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,               \
                   tc_cpu_counts *counts) {                                                                          \
    cast_tile(g, (variant){__VA_ARGS__}, x0, y0, x1, y1, out, stride, counts);                                       \
  }
#define DVR(name, voxels, ...) KERNEL(name, .mode = TC_MODE_DVR, .type = voxels, __VA_ARGS__)
#define SLICE(name, voxels, ...) KERNEL(name, .mode = TC_MODE_MPR, .type = voxels, .slab = __VA_ARGS__)
#define OF_KEY                                                                                                       \
  .shaded = g->key.shading != TC_SHADING_NONE, .terminate = g->key.termination, .leap = g->key.skipping,             \
  .labels = g->key.labels, .several = g->key.rays, .jitter = g->key.jitter, .zoomed = g->key.zoomed,      \
  .gradient = g->key.gradient
/* What most pictures are made with. One shaded kernel serves every model: they differ in numbers (raycast/shade.h).
 * special: what seldom joins the usual filter and classification is asked of the key, outside the innermost steps where
 * it can be. second: the same by preintegrated2. */
#define KERNELS(type, name)                                                                                          \
  DVR(dvr_##name##_whole, type)                                                                                      \
  DVR(dvr_##name##_early, type, .terminate = true)                                                                   \
  DVR(dvr_##name##_whole_leap, type, .leap = true)                                                                   \
  DVR(dvr_##name##_early_leap, type, .terminate = true, .leap = true)                                                \
  DVR(lit_##name##_whole, type, .shaded = true)                                                                      \
  DVR(lit_##name##_early, type, .shaded = true, .terminate = true)                                                   \
  DVR(lit_##name##_whole_leap, type, .shaded = true, .leap = true)                                                   \
  DVR(lit_##name##_early_leap, type, .shaded = true, .terminate = true, .leap = true)                                \
  DVR(special_##name, type, OF_KEY)                                                                                  \
  DVR(second_##name, type, OF_KEY, .classification = TC_PREINTEGRATED2)                                              \
  KERNEL(extreme_##name, TC_MODE_MIP, type)                                                                          \
  KERNEL(extreme_##name##_leap, TC_MODE_MIP, type, .leap = true)                                                     \
  KERNEL(average_##name, TC_MODE_AVERAGE, type)                                                                      \
  SLICE(mpr_##name##_one, type, 0)                                                                                   \
  SLICE(mpr_##name##_mip, type, 1 + TC_SLAB_MIP)                                                                     \
  SLICE(mpr_##name##_minip, type, 1 + TC_SLAB_MINIP)                                                                 \
  SLICE(mpr_##name##_average, type, 1 + TC_SLAB_AVERAGE)
#ifndef TC_ONE_KERNEL
KERNELS(TC_U8, u8)
KERNELS(TC_I8, i8)
KERNELS(TC_U16, u16)
KERNELS(TC_I16, i16)
KERNELS(TC_F32, f32)
#endif

/* The rest (back to front, other filters, the classifications to compare with), for all voxel types: once, because
 * kernels are what compiling takes long for. */
KERNEL(any, g->key.mode, g->key.voxel_type, g->key.filter, g->key.slab, OF_KEY,
       .classification = g->key.classification, .back_to_front = g->key.order == TC_BACK_TO_FRONT)

/* TC_ONE_KERNEL: builds with checks make do with it, for it is all of the text. */
#ifdef TC_ONE_KERNEL
static tc_cpu_kernel find_kernel(const tc_plan_key *key) {
  return key->voxel_type < TC_VOXEL_TYPE_COUNT && key->slab <= TC_SLAB_PROJECTION_COUNT ? any : NULL;
}
#else
/* The kernels of one voxel type. */
typedef struct kernel_set {
  tc_cpu_kernel dvr[2][2][2]; /* shaded, early termination, leaping */
  tc_cpu_kernel special, second;
  tc_cpu_kernel extreme[2];   /* skipping */
  tc_cpu_kernel average, slices[1 + TC_SLAB_PROJECTION_COUNT];
} kernel_set;

static tc_cpu_kernel find_kernel(const tc_plan_key *key) {
#define ROW(name) {{name##_whole, name##_whole_leap}, {name##_early, name##_early_leap}}
#define SET(name)                                                                                                    \
  {.dvr = {ROW(dvr_##name), ROW(lit_##name)},                                                                        \
   .special = special_##name,                                                                                        \
   .second = second_##name,                                                                                          \
   .extreme = {extreme_##name, extreme_##name##_leap},                                                               \
   .average = average_##name,                                                                                        \
   .slices = {mpr_##name##_one, [1 + TC_SLAB_MIP] = mpr_##name##_mip, [1 + TC_SLAB_MINIP] = mpr_##name##_minip,      \
              [1 + TC_SLAB_AVERAGE] = mpr_##name##_average}}
  static const kernel_set sets[TC_VOXEL_TYPE_COUNT] = {SET(u8), SET(i8), SET(u16), SET(i16), SET(f32)};
  if (key->voxel_type >= TC_VOXEL_TYPE_COUNT || key->slab > TC_SLAB_PROJECTION_COUNT) return NULL;
  const kernel_set *set = &sets[key->voxel_type];
  bool dvr = key->mode == TC_MODE_DVR, forward = key->order == TC_FRONT_TO_BACK;
  bool linear = key->filter == TC_FILTER_LINEAR, first = key->classification == TC_PREINTEGRATED;
  bool special = key->zoomed || key->labels || key->rays || key->jitter || key->gradient;
  if (dvr && forward && linear && key->classification == TC_PREINTEGRATED2) return set->second;
  if (!forward || !linear || !first || (special && !dvr)) return any;
  if (special) return set->special;
  switch (key->mode) {
  case TC_MODE_DVR: return set->dvr[key->shading != TC_SHADING_NONE][key->termination != 0][key->skipping != 0];
  case TC_MODE_MIP:
  case TC_MODE_MINIP: return set->extreme[key->skipping != 0];
  case TC_MODE_AVERAGE: return set->average;
  case TC_MODE_MPR: return set->slices[key->slab];
  default: return NULL;
  }
}
#endif
