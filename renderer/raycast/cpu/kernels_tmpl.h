/* The ray caster over the vector vocabulary: included by kernels_*.c after a simd_*.h. simd.h explains the order of the
 * pieces. */
#include "renderer/raycast/cpu/packet_tmpl.h"

#include "renderer/raycast/cpu/marches_tmpl.h"

#include "renderer/raycast/cpu/mpr_tmpl.h"

/* One ray per pixel of a packet. */
V_INLINE vf4 cast_rays(const tc_cpu_args *args, variant v, const place *at, skip_backoff *backoff,
                       tc_cpu_counts *counts) {
  vf4 c;
  if (v.mode == TC_MODE_DVR && v.back_to_front)
    cast_back_to_front(args, v, at, &c, counts);
  else if (v.mode == TC_MODE_DVR)
    cast_packet(args, v, at, &c, counts);
  else if (v.mode == TC_MODE_AVERAGE)
    cast_average(args, v, at, &c, counts);
  else if (v.mode == TC_MODE_MPR)
    cast_slice(args, v, at, &c, counts);
  else
    cast_extreme(args, v, at, backoff, &c, counts);
  return c;
}

/* Options that few pictures use are read from the key, outside the innermost loops where possible. */
#define OPTIONS                                                                                                       \
  .shaded = BY_KEY, .gradient = BY_KEY, .leap = BY_KEY, .labels = BY_KEY, .several = BY_KEY, .jitter = BY_KEY,        \
  .subtables = BY_KEY

#ifdef TC_VOXELS
/* Members that a row does not name are 0: dvr, pre-integrated, front to back, linear filter, one slice, without. */
#define ROWS_OF(ROW, name)                                                                                            \
  ROW(dvr_##name, .type = TYPE_##name)                                                                                \
  ROW(dvr_##name##_leap, .type = TYPE_##name, .leap = 1)                                                              \
  ROW(cell_##name, .type = TYPE_##name, .shaded = 1)                                                                  \
  ROW(cell_##name##_leap, .type = TYPE_##name, .shaded = 1, .leap = 1)                                                \
  ROW(lit_##name, .type = TYPE_##name, .shaded = 1, .gradient = TC_GRADIENT_CENTRAL)                                  \
  ROW(lit_##name##_leap, .type = TYPE_##name, .shaded = 1, .gradient = TC_GRADIENT_CENTRAL, .leap = 1)                \
  ROW(options_##name, .type = TYPE_##name, .classification = BY_KEY, OPTIONS)                                         \
  ROW(mip_##name, .type = TYPE_##name, .mode = TC_MODE_MIP)                                                           \
  ROW(mip_##name##_leap, .type = TYPE_##name, .mode = TC_MODE_MIP, .leap = 1)                                         \
  ROW(average_##name, .type = TYPE_##name, .mode = TC_MODE_AVERAGE)                                                   \
  ROW(slice_##name, .type = TYPE_##name, .mode = TC_MODE_MPR)                                                         \
  ROW(slab_mip_##name, .type = TYPE_##name, .mode = TC_MODE_MPR, .slab = 1 + TC_SLAB_MIP)                             \
  ROW(slab_minip_##name, .type = TYPE_##name, .mode = TC_MODE_MPR, .slab = 1 + TC_SLAB_MINIP)                         \
  ROW(slab_average_##name, .type = TYPE_##name, .mode = TC_MODE_MPR, .slab = 1 + TC_SLAB_AVERAGE)
#define ROWS(ROW) ROWS_NOW(ROW, TC_VOXELS)
#define ROWS_NOW(ROW, name) ROWS_OF(ROW, name)
#else
/* Back to front and other filters of all voxel types share one kernel, because kernels are slow to compile. */
#define ROWS(ROW)                                                                                                     \
  ROW(rest, .mode = BY_KEY, .type = BY_KEY, .filter = BY_KEY, .slab = BY_KEY, .classification = BY_KEY,               \
      .back_to_front = BY_KEY, OPTIONS)
#endif

#include "renderer/raycast/cpu/tile_tmpl.h"

/* FINDER(tc_kernel_avx2) is tc_kernel_avx2_u8, for example. */
#ifdef TC_VOXELS
#define FINDER(name) CONCATENATED(name##_, TC_VOXELS)
#else
#define FINDER(name) name##_any
#endif
