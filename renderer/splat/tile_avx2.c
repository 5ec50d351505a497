#include "renderer/splat/normal.h"
#include "renderer/splat/tile.h"

#include "renderer/raycast/cpu/simd_avx2.h"

#include "renderer/splat/tile_tmpl.h"

const tc_splat_kernels tc_splat_avx2 = {draw_depths,   draw_kept, draw_colors,   shade_tile, draw_sheet,
                                        compose_sheet, emit_tile, sizeof(batch), V_LANES};
