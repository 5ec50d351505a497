#include "renderer/backend.h"

const tc_drawer tc_drawers[TC_MODE_COUNT] = {[TC_MODE_MESH] = tc_mesh_frame_draw};
