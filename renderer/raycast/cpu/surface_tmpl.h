/* The isosurface kernels over the vector vocabulary: included by surface_*.c after a simd_*.h. */
#include "renderer/raycast/cpu/packet_tmpl.h"

#include "renderer/raycast/cpu/field_tmpl.h"

#include "renderer/raycast/cpu/cubic_tmpl.h"

#include "renderer/raycast/cpu/filter_tmpl.h"

#include "renderer/raycast/cpu/classify_tmpl.h"

#include "renderer/raycast/cpu/shade_tmpl.h"

#include "renderer/raycast/cpu/gradient_tmpl.h"

#include "renderer/raycast/cpu/isosurface_tmpl.h"

/* The mean of all rays of each pixel. */
V_INLINE vf4 cast_surfaces(const tc_cpu_surface *s, variant v, place at, tc_cpu_counts *counts) {
  vf4 sum = {v_set(0), v_set(0), v_set(0), v_set(0)};
  for (int r = 0; r < s->common.count; r++, at.ray++) {
    vf4 c = cast_surface(s, v, &at, counts);
    sum = (vf4){sum.r + c.r, sum.g + c.g, sum.b + c.b, sum.a + c.a};
  }
  vf n = v_set((float)s->common.count);
  return (vf4){sum.r / n, sum.g / n, sum.b / n, sum.a / n};
}

#define KERNEL(name, voxels)                                                                                         \
  static void name(const tc_cpu_args *g, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,               \
                   tc_cpu_counts *counts) {                                                                          \
    variant v = {.mode = TC_MODE_ISOSURFACE, .type = voxels, .shaded = g->key.shading != TC_SHADING_NONE,            \
                 .leap = g->key.skipping, .several = g->key.rays, .gradient = g->key.gradient};                     \
    for (int y = y0; y < y1; y += V_PACKET_Y)                                                                        \
      for (int x = x0; x < x1; x += V_PACKET_X) {                                                                    \
        place at = {x, y, x1, y1, g->of_pixel};                                                                      \
        vf4 c = cast_surfaces((const tc_cpu_surface *)(const void *)g, v, at, counts);                               \
        store_packet(c, &at, out + ((y - y0) * stride + (x - x0)) * 4, stride);                                      \
      }                                                                                                              \
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
