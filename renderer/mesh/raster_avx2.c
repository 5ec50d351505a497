#include "renderer/raycast/cpu/simd_avx2.h"

#include "renderer/mesh/raster_tmpl.h"

#include "renderer/mesh/raster_shade_tmpl.h"

const tc_raster_kernels tc_raster_avx2 = {draw, shade};
