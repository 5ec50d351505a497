#include "renderer/frame/backend.h"
#include "renderer/mesh/gl/mesh.h"
#include "renderer/splat/gl/splat.h"
#include "renderer/splat/mode.h"

const tc_drawer tc_drawers[TC_MODE_COUNT] = {[TC_MODE_MESH] = tc_mesh_frame_draw, [TC_MODE_SPLAT] = tc_splat_mode_draw};
const tc_gl_drawer *const tc_gl_drawers[TC_MODE_COUNT] = {[TC_MODE_MESH] = &tc_gl_mesh_drawer, [TC_MODE_SPLAT] = &tc_gl_splat_drawer};
