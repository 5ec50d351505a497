/* The isosurface kernels over the vector vocabulary: included by isosurface_*.c after a simd_*.h. */
#include "renderer/raycast/cpu/packet_tmpl.h"

#include "renderer/raycast/cpu/field_tmpl.h"

#include "renderer/raycast/cpu/cubic_tmpl.h"

#include "renderer/raycast/cpu/filter_tmpl.h"

#include "renderer/raycast/cpu/preintegration_tmpl.h"

#include "renderer/raycast/cpu/shading_tmpl.h"

#include "renderer/raycast/cpu/gradient_tmpl.h"

#include "renderer/raycast/cpu/isosurface_tmpl.h"

#define ROW_OF(ROW, name, voxels)                                                                                     \
  ROW(surface_##name, .mode = TC_MODE_ISOSURFACE, .type = voxels, .shaded = BY_KEY, .gradient = BY_KEY,               \
      .leap = BY_KEY, .several = BY_KEY)
#ifdef TC_ONE_KERNEL /* as in kernels_tmpl.h */
#define ROWS(ROW)                                                                                                     \
  ROW(surface, .mode = TC_MODE_ISOSURFACE, .type = BY_KEY, .shaded = BY_KEY, .gradient = BY_KEY, .leap = BY_KEY,      \
      .several = BY_KEY, .labels = BY_KEY)
#else
#define ROWS(ROW)                                                                                                     \
  ROW_OF(ROW, u8, TC_U8)                                                                                              \
  ROW_OF(ROW, i8, TC_I8)                                                                                              \
  ROW_OF(ROW, u16, TC_U16)                                                                                            \
  ROW_OF(ROW, i16, TC_I16)                                                                                            \
  ROW_OF(ROW, f32, TC_F32)                                                                                            \
  ROW(surface_f32_gaps, .mode = TC_MODE_ISOSURFACE, .type = TC_F32, .shaded = BY_KEY, .gradient = BY_KEY,             \
      .leap = BY_KEY, .several = BY_KEY, .labels = TC_PLAN_GAPS)
#endif

#include "renderer/raycast/cpu/tile_tmpl.h"
