/* The ray caster, once, over the vector vocabulary: included by kernels_*.c after a simd_*.h. Each piece is a header of its own;
 * here they become kernels, one per variant that plans may name. */
#include "renderer/raycast/cpu/packet_tmpl.h"

#include "renderer/raycast/cpu/field_tmpl.h"

#include "renderer/raycast/cpu/classify_tmpl.h"

#include "renderer/raycast/cpu/leap_tmpl.h"

#include "renderer/raycast/cpu/dvr_tmpl.h"

V_INLINE void cast_tile(const tc_cpu_args *g, int type, bool terminate, bool leap, int x0, int y0, int x1, int y1, float *out,
                        ptrdiff_t stride, tc_cpu_counts *counts) {
  for (int y = y0; y < y1; y += V_PACKET_Y)
    for (int x = x0; x < x1; x += V_PACKET_X) {
      vf4 c;
      cast_packet(g, type, terminate, leap, x, y, x1, y1, &c, counts);
      float lanes[4][V_LANES];
      v_store(lanes[0], c.r);
      v_store(lanes[1], c.g);
      v_store(lanes[2], c.b);
      v_store(lanes[3], c.a);
      for (int l = 0; l < V_LANES; l++) {
        int px = x + l % V_PACKET_X, py = y + l / V_PACKET_X;
        if (px >= x1 || py >= y1) continue;
        float *pixel = out + ((py - y0) * stride + (px - x0)) * 4;
        for (int k = 0; k < 4; k++) pixel[k] = lanes[k][l];
      }
    }
}

#define KERNEL(type, terminate, leap, name)                                                                          \
  static void name(const tc_cpu_args *g, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,               \
                   tc_cpu_counts *counts) {                                                                          \
    cast_tile(g, type, terminate, leap, x0, y0, x1, y1, out, stride, counts);                                        \
  }
#define KERNELS(type, name)                                                                                          \
  KERNEL(type, false, false, name##_whole)                                                                           \
  KERNEL(type, true, false, name##_early)                                                                            \
  KERNEL(type, false, true, name##_whole_leap)                                                                       \
  KERNEL(type, true, true, name##_early_leap)
KERNELS(TC_U8, dvr_u8)
KERNELS(TC_I8, dvr_i8)
KERNELS(TC_U16, dvr_u16)
KERNELS(TC_I16, dvr_i16)
KERNELS(TC_F32, dvr_f32)

static tc_cpu_kernel find_kernel(const tc_plan_key *key) {
#define ROW(name) {{name##_whole, name##_whole_leap}, {name##_early, name##_early_leap}}
  static const tc_cpu_kernel dvr[TC_VOXEL_TYPE_COUNT][2][2] = {ROW(dvr_u8), ROW(dvr_i8), ROW(dvr_u16), ROW(dvr_i16),
                                                               ROW(dvr_f32)};
  if (key->mode != TC_MODE_DVR || key->voxel_type >= TC_VOXEL_TYPE_COUNT) return NULL;
  return dvr[key->voxel_type][key->termination != 0][key->skipping != 0];
}
