#include "renderer/backend.h"

const tc_drawer tc_drawers[TC_MODE_COUNT] = {NULL};
