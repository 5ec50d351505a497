#include "renderer/splat/normal.h"
#include "renderer/splat/tile.h"

#include "renderer/raycast/cpu/simd_scalar.h"

#include "renderer/splat/tile_tmpl.h"

const tc_splat_kernels tc_splat_scalar = {put_depths,    put_kept,  put_colors,    shade_tile, put_sheet,
                                          compose_sheet, emit_tile, sizeof(batch), V_LANES};
