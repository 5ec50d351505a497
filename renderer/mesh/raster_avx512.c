#include "renderer/raycast/cpu/simd_avx512.h"

#include "renderer/mesh/raster_tmpl.h"

#include "renderer/mesh/raster_shade_tmpl.h"

const tc_raster_kernels tc_raster_avx512 = {draw, shade};
