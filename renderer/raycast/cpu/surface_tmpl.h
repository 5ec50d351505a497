/* The isosurface kernels over the vector vocabulary: included by surface_*.c after a simd_*.h. */
#include "renderer/raycast/cpu/packet_tmpl.h"

#include "renderer/raycast/cpu/field_tmpl.h"

#include "renderer/raycast/cpu/cubic_tmpl.h"

#include "renderer/raycast/cpu/filter_tmpl.h"

#include "renderer/raycast/cpu/classify_tmpl.h"

#include "renderer/raycast/cpu/shade_tmpl.h"

#include "renderer/raycast/cpu/gradient_tmpl.h"

#include "renderer/raycast/cpu/isosurface_tmpl.h"

/* The mean of all rays of each pixel; left between two rays, the sum so far. */
V_INLINE vf4 cast_surfaces(const tc_cpu_surface *s, variant v, place at, const float *out, ptrdiff_t stride,
                           tc_cpu_counts *counts) {
  vf4 sum = {v_set(0), v_set(0), v_set(0), v_set(0)};
  if (counts->ray) sum = load_packet(&at, out, stride);
  at.ray += counts->ray;
  for (int r = counts->ray; r < s->common.count; r++, at.ray++) {
    vf4 c = cast_surface(s, v, &at, counts);
    if (counts->left) {
      counts->ray = r;
      return sum;
    }
    sum = (vf4){sum.r + c.r, sum.g + c.g, sum.b + c.b, sum.a + c.a};
  }
  counts->ray = 0;
  vf n = v_set((float)s->common.count);
  return (vf4){sum.r / n, sum.g / n, sum.b / n, sum.a / n};
}

V_INLINE void cast_surface_tile(const tc_cpu_surface *s, variant v, int x0, int y0, int x1, int y1, float *out,
                                ptrdiff_t stride, tc_cpu_counts *counts) {
  int packet = 0;
  for (int y = y0; y < y1; y += V_PACKET_Y)
    for (int x = x0; x < x1; x += V_PACKET_X, packet++) {
      if (packet < counts->packet) continue;
      place at = {x, y, x1, y1, s->common.of_pixel};
      float *to = out + ((y - y0) * stride + (x - x0)) * 4;
      vf4 c = cast_surfaces(s, v, at, to, stride, counts);
      store_packet(c, &at, to, stride);
      counts->packet = packet + !counts->left;
      if (counts->left) return;
    }
}

#define KERNEL(name, voxels)                                                                                         \
  static void name(const tc_cpu_args *g, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,               \
                   tc_cpu_counts *counts) {                                                                          \
    variant v = {.mode = TC_MODE_ISOSURFACE, .type = voxels, .shaded = g->key.shading != TC_SHADING_NONE,            \
                 .leap = g->key.skipping, .several = g->key.rays, .gradient = g->key.gradient};                     \
    cast_surface_tile((const tc_cpu_surface *)(const void *)g, v, x0, y0, x1, y1, out, stride, counts);              \
  }
KERNEL(surface_u8, TC_U8)
KERNEL(surface_i8, TC_I8)
KERNEL(surface_u16, TC_U16)
KERNEL(surface_i16, TC_I16)
KERNEL(surface_f32, TC_F32)

static tc_cpu_kernel find_kernel(const tc_plan_key *key) {
  static const tc_cpu_kernel kernels[TC_VOXEL_TYPE_COUNT] = {surface_u8, surface_i8, surface_u16, surface_i16,
                                                             surface_f32};
  return key->voxel_type < TC_VOXEL_TYPE_COUNT ? kernels[key->voxel_type] : NULL;
}
