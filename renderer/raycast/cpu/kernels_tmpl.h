/* The ray caster, once, over the vector vocabulary: included by kernels_*.c after a simd_*.h. Each piece is a header of its own;
 * here they become kernels, one per variant that plans may name. */
#include "renderer/raycast/cpu/packet_tmpl.h"

#include "renderer/raycast/cpu/field_tmpl.h"

#include "renderer/raycast/cpu/classify_tmpl.h"

#include "renderer/raycast/cpu/shade_tmpl.h"

#include "renderer/raycast/cpu/leap_tmpl.h"

#include "renderer/raycast/cpu/dvr_tmpl.h"

#include "renderer/raycast/cpu/projection_tmpl.h"

#include "renderer/raycast/cpu/mpr_tmpl.h"

/* mode, type, shaded, terminate and leap are constants of the variant. */
V_INLINE void cast_tile(const tc_cpu_args *g, int mode, int type, bool shaded, bool terminate, bool leap, int x0, int y0,
                        int x1, int y1, float *out, ptrdiff_t stride, tc_cpu_counts *counts) {
  skip_mood mood = {0};
  for (int y = y0; y < y1; y += V_PACKET_Y)
    for (int x = x0; x < x1; x += V_PACKET_X) {
      vf4 c;
      if (mode == TC_MODE_DVR)
        cast_packet(g, type, shaded, terminate, leap, x, y, x1, y1, &c, counts);
      else if (mode == TC_MODE_AVERAGE)
        cast_average(g, type, x, y, x1, y1, &c, counts);
      else
        cast_extreme(g, type, leap, x, y, x1, y1, &mood, &c, counts);
      store_packet(c, x, y, x1, y1, out + ((y - y0) * stride + (x - x0)) * 4, stride);
    }
}

#define KERNEL(mode, type, shaded, terminate, leap, name)                                                                    \
  static void name(const tc_cpu_args *g, int x0, int y0, int x1, int y1, float *out, ptrdiff_t stride,               \
                   tc_cpu_counts *counts) {                                                                          \
    cast_tile(g, mode, type, shaded, terminate, leap, x0, y0, x1, y1, out, stride, counts);                          \
  }
/* One shaded kernel serves every model: they differ in numbers (raycast/shade.h). */
#define KERNELS(type, name)                                                                                          \
  KERNEL(TC_MODE_DVR, type, false, false, false, dvr_##name##_whole)                                                        \
  KERNEL(TC_MODE_DVR, type, false, true, false, dvr_##name##_early)                                                         \
  KERNEL(TC_MODE_DVR, type, false, false, true, dvr_##name##_whole_leap)                                                    \
  KERNEL(TC_MODE_DVR, type, false, true, true, dvr_##name##_early_leap)                                                     \
  KERNEL(TC_MODE_DVR, type, true, false, false, lit_##name##_whole)                                                  \
  KERNEL(TC_MODE_DVR, type, true, true, false, lit_##name##_early)                                                   \
  KERNEL(TC_MODE_DVR, type, true, false, true, lit_##name##_whole_leap)                                              \
  KERNEL(TC_MODE_DVR, type, true, true, true, lit_##name##_early_leap)                                               \
  KERNEL(TC_MODE_MIP, type, false, false, false, extreme_##name)                                                            \
  KERNEL(TC_MODE_MIP, type, false, false, true, extreme_##name##_leap)                                                      \
  KERNEL(TC_MODE_AVERAGE, type, false, false, false, average_##name)
KERNELS(TC_U8, u8)
KERNELS(TC_I8, i8)
KERNELS(TC_U16, u16)
KERNELS(TC_I16, i16)
KERNELS(TC_F32, f32)

static tc_cpu_kernel find_kernel(const tc_plan_key *key) {
#define ROW(name) {{name##_whole, name##_whole_leap}, {name##_early, name##_early_leap}}
  static const tc_cpu_kernel dvr[2][TC_VOXEL_TYPE_COUNT][2][2] = {
      {ROW(dvr_u8), ROW(dvr_i8), ROW(dvr_u16), ROW(dvr_i16), ROW(dvr_f32)},
      {ROW(lit_u8), ROW(lit_i8), ROW(lit_u16), ROW(lit_i16), ROW(lit_f32)}};
#define PROJECTIONS(name) {extreme_##name, extreme_##name##_leap, average_##name}
  static const tc_cpu_kernel projections[TC_VOXEL_TYPE_COUNT][3] = {PROJECTIONS(u8), PROJECTIONS(i8), PROJECTIONS(u16),
                                                                    PROJECTIONS(i16), PROJECTIONS(f32)};
  if (key->mode == TC_MODE_MPR) return find_slice_kernel(key);
  if (key->voxel_type >= TC_VOXEL_TYPE_COUNT) return NULL;
  if (key->mode == TC_MODE_DVR)
    return dvr[key->shading != TC_SHADING_NONE][key->voxel_type][key->termination != 0][key->skipping != 0];
  if (key->mode == TC_MODE_MIP || key->mode == TC_MODE_MINIP) return projections[key->voxel_type][key->skipping != 0];
  return key->mode == TC_MODE_AVERAGE ? projections[key->voxel_type][2] : NULL;
}
